//! The maths of `soft/width*.wesl` and `soft/radial.wesl`: shadow widths, and what is made of them.

use glam::{DVec2, IVec2};

use super::Seen;
use super::techniques::{Map, Receiver};
use crate::{SingleSample, WidthLookup, Widths};

/// Width of a texel from which no lit one was found, as in `soft/width_steps.wesl`.
pub const UNREACHED: f64 = 131_072.0;

/// Most doublings: maps have no more than 2^14 texels a side.
pub const MAX_DOUBLINGS: u32 = 14;

/// Steps of a length, shorter sides of a texel: sums of fewer than 2^24 of them are exact in `f32`.
const LENGTH_STEPS: f64 = 64.0;

/// A step from texel to texel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Texels.
    pub offset: IVec2,
    /// Shorter sides of a texel, a multiple of 1/64.
    pub length: f64,
}

impl Step {
    fn new(offset: IVec2, sides: DVec2) -> Self {
        let length = (offset.as_dvec2() * sides).length();
        Self { offset, length: ((length * LENGTH_STEPS).round() / LENGTH_STEPS).min(UNREACHED) }
    }
}

/// Steps of the sweeps, in the order of their passes. `sides` are those of a texel, of which the shorter is 1.
#[must_use]
pub fn sweeps(sides: DVec2) -> [Step; 4] {
    [(1, 0), (-1, 0), (0, 1), (0, -1)].map(|(x, y)| Step::new(IVec2::new(x, y), sides))
}

/// Steps of doubling `k` to `neighbours` in all directions: 4 along the axes, 8 along the diagonals, too, 6 and 3 at
/// equal angles, to the nearest texel.
#[must_use]
pub fn doubling(neighbours: u32, k: u32, sides: DVec2) -> Vec<Step> {
    let far = f64::from(1u32 << k);
    let offset = |i: u32| {
        if neighbours == 8 {
            let compass = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)];
            let (x, y) = compass[i as usize % 8];
            return IVec2::new(x, y) * (1 << k);
        }
        let angle = std::f64::consts::TAU * f64::from(i) / f64::from(neighbours);
        // Halves go to the nearer texel: at a distance of 1 the six are those along the axes.
        let nearest = |x: f64| (x.abs() - 1e-9).round() * x.signum();
        let to = DVec2::from_angle(angle) * far;
        DVec2::new(nearest(to.x), nearest(to.y)).as_ivec2()
    };
    (0..neighbours).map(|i| Step::new(offset(i), sides)).collect()
}

/// The steps of every pass, in order.
#[must_use]
pub fn passes(widths: Widths, neighbours: u32, doublings: u32, sides: DVec2) -> Vec<Vec<Step>> {
    match widths {
        Widths::Doubling => (0..doublings).map(|k| doubling(neighbours, k, sides)).collect(),
        Widths::CityBlock => sweeps(sides).map(|step| vec![step]).into(),
        // Columns are searched both ways by one pass.
        Widths::Euclidean => sweeps(sides)[..3].iter().map(|step| vec![*step]).collect(),
    }
}

/// How many doublings reach a width: 2^K - 1 texels of a side of 1. No map of `size` texels needs more than reach its border
/// from the middle, or across where three neighbours lead to one side of it only.
#[must_use]
pub fn doublings_for(width: f64, size: u32, neighbours: u32) -> u32 {
    let across = f64::from(if neighbours == 3 { size } else { size / 2 + 1 });
    let width = if width.is_finite() { width.clamp(0.0, across) } else { across };
    ((width + 1.0).log2().ceil() as u32).clamp(1, MAX_DOUBLINGS)
}

/// One pass of doubling over a map of `size` texels a side, row by row.
#[must_use]
pub fn doubled(widths: &[f64], size: i32, steps: &[Step]) -> Vec<f64> {
    let at = |p: IVec2| {
        let inside = p.min_element() >= 0 && p.max_element() < size;
        if inside { widths[(p.y * size + p.x) as usize] } else { 0.0 }
    };
    texels(size)
        .map(|p| {
            let stepped = steps.iter().map(|s| at(p + s.offset) + s.length);
            stepped.fold(at(p), f64::min).min(UNREACHED)
        })
        .collect()
}

/// One sweep.
#[must_use]
pub fn swept(widths: &[f64], size: i32, step: Step) -> Vec<f64> {
    let mut swept = widths.to_vec();
    let last = size - 1;
    for line in 0..size {
        let mut at = if step.offset.x == 0 { IVec2::new(line, 0) } else { IVec2::new(0, line) };
        at = IVec2::select(step.offset.cmplt(IVec2::ZERO), last - at, at);
        let mut width = 0.0;
        for _ in 0..size {
            let texel = &mut swept[(at.y * size + at.x) as usize];
            width = texel.min(width + step.length);
            *texel = width;
            at += step.offset;
        }
    }
    swept
}

/// Distances in the plane from those along rows.
fn euclid(rows: &[f64], size: i32, length: f64) -> Vec<f64> {
    let at = |p: IVec2| {
        let inside = p.y >= 0 && p.y < size;
        if inside { rows[(p.y * size + p.x) as usize] } else { 0.0 }
    };
    texels(size)
        .map(|p| {
            let column = |i: i32| at(p.with_y(i)).powi(2) + (f64::from(i - p.y) * length).powi(2);
            (-1..=size).map(column).fold(f64::INFINITY, f64::min).sqrt()
        })
        .collect()
}

/// Widths of a map of `size` texels a side of which `blocked` ones are hidden, row by row.
#[must_use]
pub fn width_map(
    config: &SingleSample,
    doublings: u32,
    blocked: &[bool],
    sides: DVec2,
) -> Vec<f64> {
    let size = blocked.len().isqrt() as i32;
    let mut widths: Vec<f64> = blocked.iter().map(|b| if *b { UNREACHED } else { 0.0 }).collect();
    for (i, steps) in passes(config.widths, config.neighbours, doublings, sides).iter().enumerate()
    {
        widths = match config.widths {
            Widths::Doubling => doubled(&widths, size, steps),
            Widths::Euclidean if i == 2 => euclid(&widths, size, steps[0].length),
            _ => swept(&widths, size, steps[0]),
        };
    }
    widths
}

fn texels(size: i32) -> impl Iterator<Item = IVec2> {
    (0..size * size).map(move |i| IVec2::new(i % size, i / size))
}

/// The attenuation function: 1 where `depth` or `width` is 0, and else falling with width / depth, which is in halves of
/// the penumbra behind a straight edge.
#[must_use]
pub fn attenuation(depth: f64, width: f64, scale: f64, bias: f64) -> f64 {
    if depth <= 0.0 || width <= 0.0 {
        return 1.0;
    }
    (1.0 + bias - scale * width / depth).clamp(0.0, 1.0)
}

impl Seen {
    /// Half the penumbra behind a straight edge, `depth` before the receiver, in shorter sides of a texel; of a light as
    /// wide as the square root of its area.
    #[must_use]
    pub fn half_penumbra(&self, depth: f64) -> f64 {
        self.scale.max_element() * self.shape.determinant().abs().sqrt() * depth
    }
}

impl Map<'_> {
    /// `visibility` of `soft/width.wesl`, with widths from `width`.
    #[must_use]
    pub fn single_sample(
        &self,
        receiver: &Receiver,
        config: &SingleSample,
        width: &dyn Fn(i32, i32) -> f64,
    ) -> f64 {
        let light = &receiver.light;
        let inside = |p: IVec2| p.min_element() >= 0 && p.max_element() < self.size;
        let depth_in = |p: IVec2| {
            let stored = inside(p).then(|| (self.depth)(p.x, p.y));
            stored.filter(|d| receiver.blocks(p, *d)).map(|d| (d - light.depth).max(0.0))
        };
        let width_in = |p: IVec2| if inside(p) { width(p.x, p.y) } else { 0.0 };
        let shade = |depth: f64, width: f64| {
            let half = light.half_penumbra(depth);
            attenuation(half.max(1e-30), width, f64::from(config.scale), f64::from(config.bias))
        };
        let own = light.texel.floor().as_ivec2();
        let first = (light.texel - 0.5).floor().as_ivec2();
        let t = light.texel - 0.5 - first.as_dvec2();
        let weighted = |value: &dyn Fn(IVec2) -> f64| -> f64 {
            let corner = |x: i32, y: i32| {
                let weight = |t: f64, far: i32| if far == 1 { t } else { 1.0 - t };
                weight(t.x, x) * weight(t.y, y) * value(first + IVec2::new(x, y))
            };
            corner(0, 0) + corner(1, 0) + corner(0, 1) + corner(1, 1)
        };
        if config.lookup == WidthLookup::Linear {
            let depth = weighted(&|p| depth_in(p).unwrap_or(0.0));
            return if depth > 0.0 { shade(depth, weighted(&width_in)) } else { 1.0 };
        }
        let Some(depth) = depth_in(own) else { return 1.0 };
        if config.lookup == WidthLookup::Texel {
            return shade(depth, width_in(own));
        }
        let side = light.scale.max_element() / (light.scale.x * light.scale.y).sqrt();
        shade(depth, (weighted(&width_in) - 0.5 * side).max(0.0))
    }

    /// `visibility` of `soft/radial.wesl`, over all texels of the window.
    #[must_use]
    pub fn radial(&self, receiver: &Receiver) -> f64 {
        let light = &receiver.light;
        let [lo, hi] = light.window(light.view.nearest);
        let in_window = |p: IVec2| {
            let corner = p.as_dvec2();
            corner.cmpgt(lo - 1.0).all() && corner.cmplt(hi).all()
        };
        let inside = |p: IVec2| p.min_element() >= 0 && p.max_element() < self.size;
        let hidden_by = |p: IVec2| {
            let stored = inside(p).then(|| (self.depth)(p.x, p.y));
            stored.filter(|d| receiver.blocks(p, *d)).map(|d| d - light.depth)
        };
        let in_penumbra = |off: DVec2, depth: f64| {
            let s = light.on_light(off / (light.scale * depth.max(1e-30)));
            if light.round { s.length() } else { s.abs().max_element() }
        };
        let own = hidden_by(light.texel.floor().as_ivec2());
        let (mut nearest, mut share) = (f64::INFINITY, 1.0f64);
        // One ring of texels beyond the border: there all is lit.
        for p in texels(self.size + 2).map(|p| p - 1) {
            let depth = hidden_by(p);
            if depth.is_some() == own.is_some() || inside(p) && !in_window(p) {
                continue;
            }
            let corner = p.as_dvec2();
            let off = light.texel.clamp(corner, corner + 1.0) - light.texel;
            let distance = in_penumbra(off, light.view.nearest - light.depth);
            let Some(depth) = own.or(depth) else { continue };
            if distance < nearest {
                (nearest, share) = (distance, in_penumbra(off, depth));
            } else if distance == nearest {
                share = share.min(in_penumbra(off, depth));
            }
        }
        let half = 0.5 * share.min(1.0);
        if own.is_some() { 0.5 - half } else { 0.5 + half }
    }
}

#[cfg(test)]
#[path = "width_tests.rs"]
mod tests;
