//! What is true: the visibility of a light from view samples, by ray tracing.
//!
//! V(p) is the fraction of the light's area that p sees, each point of it weighted by what translucent casters let
//! through. Points of the light below the tangent plane of
//! p are hidden by the receiver itself. Area lights are sampled with a (0,2)-sequence (Sobol 1967),
//! Owen-scrambled anew for every view sample by a hash (Laine and Karras 2011 in the form of Burley
//! 2020, "Practical Hash-based Owen Scrambling"): for the edge of a shadow across the light the error
//! falls as n^-0.75, and the errors of neighbouring samples are independent.
//!
//! # Where a ray starts
//! With u = 2^-24 and M the largest coordinate of scene and samples, a ray from p must not meet p's own
//! surface. The triangle test is exact for corners displaced by at most 5 u D along two axes and u D
//! along the third, D <= 2 M being the largest difference of coordinates (see `tracer::traverse`),
//! hence by sqrt(51) u D < 14.3 u M in any direction. Rounding the direction to `f32` turns it by up
//! to sqrt(3) u, which sinks it by 3.5 u M over D; rounding the normal does the same; rounding the
//! start adds sqrt(3) u M: together less than 24 u M. The ray starts above p by 24 u M plus the
//! error of p itself ([`TruthOptions::position_error`]). Towards a light of finite distance it ends
//! short of it by the same length (and, at a rectangle or disc, is aimed at a point lifted off the
//! light's plane by as much), so that a lamp's own surface does not hide it.

use std::time::Instant;

use antumbra_scene::{Emission, Light};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::tracer::{Ray, Tracer, U};
use crate::{SampleClass, ViewSample};

/// How [`Tracer::truth`] works.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TruthOptions {
    /// Points on an area light, for each view sample; hard lights take one. Rounded up to an even
    /// number; powers of two are best. At 1024 the root mean square error of a penumbra sample is
    /// below 2e-3, and it falls as the power -0.75. Default 256, the cost is proportional.
    pub light_samples: u32,
    /// Whether to look for ties ([`SampleClass::Tie`]) of hard lights, for eight more rays a sample: behind translucent
    /// casters, jumps of visibility of at least 0.01. Default false.
    pub ties: bool,
    /// How near a hard shadow's boundary must be to a sample for a tie, relative to the scene's
    /// bounding radius. The offset of the ray's start is added. Default 1e-5.
    pub tie_distance: f64,
    /// Largest error of the samples' positions, relative to the largest coordinate. Default 2^-21:
    /// eight roundings, enough for positions that were interpolated in `f32`.
    pub position_error: f64,
    /// Chooses among random scramblings. Default 0.
    pub seed: u64,
}

impl Default for TruthOptions {
    fn default() -> Self {
        Self {
            light_samples: 256,
            ties: false,
            tie_distance: 1e-5,
            position_error: 1.0 / f64::from(1 << 21),
            seed: 0,
        }
    }
}

/// The visibility of a light from view samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// For each sample, the fraction of the light's area that it sees, in [0, 1]. 0 where the class
    /// is [`SampleClass::FacingAway`] or [`SampleClass::Missing`].
    pub visibility: Vec<f32>,
    /// For each sample, whether it counts.
    pub class: Vec<SampleClass>,
    /// Points on the light for each sample.
    pub light_samples: u32,
    /// Estimate of the root mean square error of visibility over samples in the penumbra (counted and
    /// strictly between 0 and 1): half of the difference of the two halves of the light samples. The
    /// halves miss what makes the whole sequence even, so that it is too large, by up to a factor 1.4.
    /// 0 without such samples.
    pub error_estimate: f64,
    /// Rays traced.
    pub rays: u64,
    /// Wall-clock time, seconds.
    pub seconds: f64,
}

/// One sample's result.
struct Seen {
    visibility: f32,
    class: SampleClass,
    /// Difference between the visibilities by the two halves of the light samples.
    halves: f64,
    rays: u64,
}

impl Seen {
    fn nothing(class: SampleClass) -> Self {
        Self { visibility: 0.0, class, halves: 0.0, rays: 0 }
    }
}

impl Tracer {
    /// The visibility of `light` (world space) from `samples` (relative to the triangles' origin), on
    /// all cores.
    ///
    /// The result does not depend on the number of threads; that of a sample depends, through the
    /// scrambling, on its index.
    #[must_use]
    pub fn truth(&self, light: &Light, samples: &[ViewSample], options: &TruthOptions) -> Truth {
        self.truth_of(light, None, samples, options)
    }

    /// As [`Tracer::truth`], of a rectangle or a disc that is brighter here than there: the share of what it emits that is seen.
    #[must_use]
    pub fn truth_of(
        &self,
        light: &Light,
        emission: Option<&Emission>,
        samples: &[ViewSample],
        options: &TruthOptions,
    ) -> Truth {
        let start = Instant::now();
        let light = moved(light, -self.origin());
        let extent = samples
            .iter()
            .filter(|s| s.position.is_finite())
            .map(|s| s.position.abs().max_element())
            .fold(self.extent(), f32::max);
        let extent = f64::from(extent);
        let count =
            if light.is_hard() { 1 } else { options.light_samples.max(2).next_multiple_of(2) };
        let eye = Eye {
            tracer: self,
            light,
            emission,
            lift: extent * (24.0 * f64::from(U) + options.position_error),
            tie: options.ties.then_some(options.tie_distance * f64::from(self.radius())),
            seed: options.seed,
            points: sobol(count),
        };
        let seen: Vec<Seen> = samples
            .par_iter()
            .enumerate()
            .with_min_len(16)
            .map(|(index, sample)| eye.sees(index, sample))
            .collect();
        // Sums in the order of the samples, whichever thread made them.
        let (mut squares, mut penumbra) = (0.0, 0_u64);
        for s in &seen {
            if s.class == SampleClass::Counted && s.visibility > 0.0 && s.visibility < 1.0 {
                squares += 0.25 * s.halves * s.halves;
                penumbra += 1;
            }
        }
        Truth {
            light_samples: count,
            error_estimate: (squares / penumbra.max(1) as f64).sqrt(),
            rays: seen.iter().map(|s| s.rays).sum(),
            visibility: seen.iter().map(|s| s.visibility).collect(),
            class: seen.iter().map(|s| s.class).collect(),
            seconds: start.elapsed().as_secs_f64(),
        }
    }
}

/// The least difference of visibility that is an edge and no shading within a translucent surface.
const JUMP: f64 = 0.01;

/// All that the samples share.
struct Eye<'a> {
    tracer: &'a Tracer,
    /// Relative to the triangles' origin.
    light: Light,
    emission: Option<&'a Emission>,
    /// Height of the rays' starts above the samples, metres.
    lift: f64,
    /// Distance for ties, metres.
    tie: Option<f64>,
    seed: u64,
    points: Vec<[u32; 2]>,
}

impl Eye<'_> {
    fn sees(&self, index: usize, sample: &ViewSample) -> Seen {
        let usable = sample.position.is_finite() && sample.normal.is_finite();
        let normal = sample.normal.as_dvec3().normalize_or_zero();
        if !usable || normal == DVec3::ZERO {
            return Seen::nothing(SampleClass::Missing);
        }
        let p = sample.position.as_dvec3();
        if highest(&self.light, p, normal) <= 0.0 {
            return Seen::nothing(SampleClass::FacingAway);
        }
        let class = if outside_cone(&self.light, p) {
            SampleClass::OutsideLight
        } else {
            SampleClass::Counted
        };
        if let [_] = *self.points {
            return self.sees_hard(p, normal, class);
        }
        // A new scrambling for each sample and dimension, and for each seed.
        let key = hash(self.seed ^ hash(index as u64));
        let scramble = [key as u32, (key >> 32) as u32];
        let mut visible = [0.0; 2];
        let (mut total, mut traced) = (0.0, 0);
        for (points, visible) in self.points.chunks(self.points.len() / 2).zip(&mut visible) {
            let unit = |point: &[u32; 2], d: usize| {
                // The middle of the cell of size 2^-32.
                (f64::from(owen(point[d], scramble[d])) + 0.5) / 4_294_967_296.0
            };
            let places = points.iter().map(|point| DVec2::new(unit(point, 0), unit(point, 1)));
            let all: Vec<(DVec3, f64)> =
                places.map(|at| (self.light.towards(p, at), self.emitted(at))).collect();
            total += all.iter().map(|(_, emitted)| emitted).sum::<f64>();
            let (rays, emitted): (Vec<Ray>, Vec<f64>) = all
                .into_iter()
                .filter(|(to_light, _)| normal.dot(*to_light) > 0.0)
                .map(|(to_light, emitted)| (self.ray(p, normal, to_light), emitted))
                .unzip();
            let mut blocked = vec![false; rays.len()];
            self.tracer.occluded_each(&rays, &mut blocked);
            let free = rays.iter().zip(&emitted).zip(&blocked).filter(|(_, blocked)| !**blocked);
            let has_sheets = self.tracer.has_sheets();
            let through = |ray| if has_sheets { self.tracer.through(ray) } else { 1.0 };
            *visible = free.map(|((ray, emitted), _)| emitted * through(ray)).sum();
            traced += rays.len() as u64;
        }
        // An image may be dark wherever a disc is.
        let total = if total > 0.0 { total } else { 1.0 };
        Seen {
            visibility: ((visible[0] + visible[1]) / total) as f32,
            class,
            halves: (visible[0] - visible[1]) / (0.5 * total),
            rays: traced,
        }
    }

    fn sees_hard(&self, p: DVec3, normal: DVec3, class: SampleClass) -> Seen {
        let to_light = self.light.towards(p, DVec2::splat(0.5));
        let visible = self.reaches(p, normal, to_light);
        let mut seen = Seen { visibility: visible as f32, class, halves: 0.0, rays: 1 };
        if let (Some(tie), SampleClass::Counted) = (self.tie, class) {
            // Lifting p by h moves the shadow's boundary by h tan(angle between normal and light).
            let cos = normal.dot(to_light.normalize());
            let distance = tie + self.lift * (1.0 + (1.0 - cos * cos).max(0.0).sqrt() / cos);
            let distance = distance.min(f64::from(self.tracer.radius()).max(tie));
            let u = normal.any_orthonormal_vector();
            let v = normal.cross(u);
            for i in 0..8 {
                let (sin, cos) = (f64::from(i) * std::f64::consts::FRAC_PI_4).sin_cos();
                let q = p + distance * (u * cos + v * sin);
                let to_light = self.light.towards(q, DVec2::splat(0.5));
                seen.rays += 1;
                if (self.reaches(q, normal, to_light) - visible).abs() >= JUMP {
                    seen.class = SampleClass::Tie;
                    break;
                }
            }
        }
        seen
    }

    /// What the light emits at `sample` of the unit square, relative to its mean.
    fn emitted(&self, sample: DVec2) -> f64 {
        self.emission.map_or(1.0, |emission| emission.at(self.light.place(sample)))
    }

    /// What gets to `p` from the point of the light at `p + to_light`.
    fn reaches(&self, p: DVec3, normal: DVec3, to_light: DVec3) -> f64 {
        self.tracer.transmittance(&self.ray(p, normal, to_light))
    }

    /// From just above `p` to just before the point of the light at `p + to_light`.
    fn ray(&self, p: DVec3, normal: DVec3, to_light: DVec3) -> Ray {
        let start = (p + normal * self.lift).as_vec3();
        let (way, end) = match self.light {
            Light::Directional { .. } => (to_light, f64::INFINITY),
            _ => {
                let lifted = match self.light {
                    Light::Rect { half_u, half_v, .. } => half_u.cross(half_v).normalize_or_zero(),
                    Light::Disc { axis_u, axis_v, .. } => axis_u.cross(axis_v),
                    _ => DVec3::ZERO,
                };
                let lifted = lifted * self.lift.copysign(-lifted.dot(to_light));
                let way = p + to_light + lifted - start.as_dvec3();
                (way, 1.0 - self.lift / way.length())
            }
        };
        Ray { origin: start, direction: way.as_vec3(), t_max: end as f32 }
    }
}

/// The greatest height of a point of the light above the tangent plane of `p`, metres (without unit
/// for a directional light): all of the light is hidden where it is <= 0.
fn highest(light: &Light, p: DVec3, normal: DVec3) -> f64 {
    // A disc across the unit axis `a` rises above its centre by its radius times the sine of the
    // angle between the axis and the normal.
    let across = |a: DVec3| (normal - a * normal.dot(a)).length();
    match *light {
        Light::Directional { direction, angular_diameter } => {
            normal.dot(-direction) + (0.5 * angular_diameter).tan() * across(direction)
        }
        Light::Point { position } | Light::Spot { position, .. } => normal.dot(position - p),
        Light::Sphere { center, radius } => {
            normal.dot(center - p) + radius * across((center - p).normalize_or(DVec3::Y))
        }
        Light::Rect { center, half_u, half_v } => {
            normal.dot(center - p) + normal.dot(half_u).abs() + normal.dot(half_v).abs()
        }
        Light::Disc { center, radius, axis_u, axis_v } => {
            normal.dot(center - p) + radius * normal.dot(axis_u).hypot(normal.dot(axis_v))
        }
    }
}

/// Whether a spot light's cone excludes `p`.
fn outside_cone(light: &Light, p: DVec3) -> bool {
    match *light {
        Light::Spot { position, direction, outer_angle } => {
            direction.dot((p - position).normalize_or(direction)) < outer_angle.cos()
        }
        _ => false,
    }
}

/// The light moved by `offset`.
fn moved(light: &Light, offset: DVec3) -> Light {
    let mut light = *light;
    match &mut light {
        Light::Directional { .. } => {}
        Light::Point { position } | Light::Spot { position, .. } => *position += offset,
        Light::Sphere { center, .. } | Light::Rect { center, .. } | Light::Disc { center, .. } => {
            *center += offset;
        }
    }
    light
}

/// The first `count` points of Sobol's (0,2)-sequence, in units of 2^-32.
fn sobol(count: u32) -> Vec<[u32; 2]> {
    (0..count)
        .map(|i| {
            // The second dimension's direction numbers: the rows of Pascal's triangle modulo 2.
            let (mut y, mut direction, mut rest) = (0, 1_u32 << 31, i);
            while rest != 0 {
                if rest & 1 == 1 {
                    y ^= direction;
                }
                direction ^= direction >> 1;
                rest >>= 1;
            }
            [i.reverse_bits(), y]
        })
        .collect()
}

/// Owen's scrambling of `x` in base 2: each bit is flipped depending on `seed` and the bits above it
/// (Burley 2020; the constants are those of Vegdahl 2021, "Building a Better LK Hash").
fn owen(x: u32, seed: u32) -> u32 {
    let mut x = x.reverse_bits();
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^= x.wrapping_mul(0x53a2_2864);
    x.reverse_bits()
}

/// A bijection that spreads every bit over all (the output function of SplitMix64; Steele, Lea and
/// Flood 2014).
fn hash(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
