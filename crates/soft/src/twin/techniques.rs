//! The estimators of `shaders/soft`, over a map that is a function. Without the pyramid, which changes no answer, and
//! without the verdict of darkness, which does.

use glam::{DVec2, IVec2};

use super::Seen;
use super::coverage::quad_share;
use super::mask::Mask;
use crate::{Bitmask, Occluders, Pcss};

/// A layer of a map: its side and the reversed depth of each texel.
pub struct Map<'a> {
    /// Texels a side.
    pub size: i32,
    /// Depth of the texel in column x and row y.
    pub depth: &'a dyn Fn(i32, i32) -> f64,
}

/// A receiver in a layer.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    /// The light as it sees it, with its texel and depth.
    pub light: Seen,
    /// Its depth, moved towards the light by the slack.
    pub depth: f64,
    /// Change of its plane's depth per texel.
    pub gradient: DVec2,
    /// The bias cone: depth per texel of distance.
    pub cone: DVec2,
}

/// What a search found: the first texels and those after the last, and the side of the blocks between.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Search {
    lo: IVec2,
    hi: IVec2,
    stride: i32,
}

impl Map<'_> {
    fn inside(&self, texel: IVec2) -> bool {
        texel.min_element() >= 0 && texel.max_element() < self.size
    }

    /// `search` of `soft/search.wesl`; `None` where the receiver is lit.
    fn search(&self, light: &Seen, budget: u32) -> Option<Search> {
        let nearest = light.view.nearest;
        if nearest <= light.depth {
            return None;
        }
        let [lo, hi] = light.window(nearest);
        let limit = DVec2::splat(f64::from(self.size));
        let lo = lo.floor().clamp(DVec2::ZERO, limit).as_ivec2();
        let hi = hi.ceil().clamp(DVec2::ZERO, limit).as_ivec2();
        if hi.cmple(lo).any() {
            return None;
        }
        let budget = budget as i32;
        Some(Search { lo, hi, stride: ((hi - lo).max_element() + budget - 1) / budget })
    }

    /// Depth of the texel in the middle of `block`, if it hides something from the receiver.
    fn occluder(&self, receiver: &Receiver, block: IVec2, stride: i32) -> Option<f64> {
        let texel = (block + stride / 2).min(IVec2::splat(self.size - 1));
        if block.min_element() < 0 {
            return None;
        }
        let stored = (self.depth)(texel.x, texel.y);
        receiver.blocks(texel, stored).then_some(stored)
    }

    fn lit(&self, receiver: &Receiver, texel: IVec2) -> f64 {
        let dark = self.inside(texel) && (self.depth)(texel.x, texel.y) > receiver.reference(texel);
        if dark { 0.0 } else { 1.0 }
    }

    /// `visibility` of `soft/pcss.wesl`, and the mean distance of the blockers.
    #[must_use]
    pub fn pcss(&self, receiver: &Receiver, config: &Pcss, noise: f64) -> (f64, Option<f64>) {
        let light = &receiver.light;
        let Some(found) = self.search(light, config.window.budget) else { return (1.0, None) };
        let central = |s: DVec2| {
            let square =
                if light.round { s.length_squared() } else { s.abs().max_element().powi(2) };
            1.0 - f64::from(config.centre) * square.min(1.0)
        };
        let (mut sum, mut total) = (0.0, 0.0);
        let mut blocker = |stored: f64, weight: f64| {
            sum += weight * light.distance_of(stored);
            total += weight;
        };
        let nearest = light.view.nearest;
        let scale = light.scale * (nearest - light.depth);
        if config.search == 0 {
            let window = light.window(nearest);
            for block in found.blocks(0) {
                let area = overlap(block.as_dvec2(), f64::from(found.stride), window);
                let middle = block.as_dvec2() + 0.5 * f64::from(found.stride);
                let s = light.on_light((middle - light.texel) / scale);
                if area > 0.0
                    && (light.is_box || light.on_shape(s))
                    && let Some(stored) = self.occluder(receiver, block, found.stride)
                {
                    blocker(stored, area * central(s));
                }
            }
        }
        for i in 0..config.search {
            let s = tap(light, i, config.search, noise);
            let texel = (light.texel + light.on_plane(s) * scale).floor().as_ivec2();
            if self.inside(texel)
                && let Some(stored) = self.occluder(receiver, texel, 1)
            {
                blocker(stored, central(s));
            }
        }
        let texel = light.texel.floor().as_ivec2();
        let own = self.inside(texel).then(|| self.occluder(receiver, texel, 1)).flatten();
        let distance = match own.filter(|_| config.own) {
            Some(stored) => light.distance_of(stored),
            None if total <= 0.0 => return (1.0, None),
            None => sum / total,
        };
        (self.filtered(receiver, config, light.depth_of(distance), noise), Some(distance))
    }

    fn filtered(&self, receiver: &Receiver, config: &Pcss, depth: f64, noise: f64) -> f64 {
        let light = &receiver.light;
        let scale = light.scale * (depth - light.depth).max(0.0);
        if config.filter > 0 {
            let lit = |i| {
                let s = tap(light, i, config.filter, noise);
                let texel = light.texel + light.on_plane(s) * scale;
                self.lit(receiver, texel.floor().as_ivec2())
            };
            return (0..config.filter).map(lit).sum::<f64>() / f64::from(config.filter);
        }
        let window = [light.texel + light.lo * scale, light.texel + light.hi * scale];
        let sides = window[1] - window[0];
        let stride = (sides.max_element() / f64::from(config.window.budget)).ceil().max(1.0);
        let first = (window[0] / stride).floor() * stride;
        let (mut sum, mut total) = (0.0, 0.0);
        let mut y = first.y;
        while y < window[1].y {
            let mut x = first.x;
            while x < window[1].x {
                let block = DVec2::new(x, y);
                let middle = block + 0.5 * stride;
                let area = overlap(block, stride, window);
                let on =
                    light.is_box || light.on_shape(light.on_light((middle - light.texel) / scale));
                if area > 0.0 && on {
                    sum += area * self.lit(receiver, middle.floor().as_ivec2());
                    total += area;
                }
                x += stride;
            }
            y += stride;
        }
        if total <= 0.0 {
            return self.lit(receiver, light.texel.floor().as_ivec2());
        }
        sum / total
    }

    /// The hidden share before it is cut off at 1, of `soft/back_projection.wesl`.
    #[must_use]
    pub fn back_projection(&self, receiver: &Receiver, budget: u32) -> f64 {
        let light = &receiver.light;
        let Some(found) = self.search(light, budget) else { return 0.0 };
        let mut hidden = 0.0;
        for block in found.blocks(0) {
            let Some(stored) = self.occluder(receiver, block, found.stride) else { continue };
            let a = light.project_back(block.as_dvec2(), stored);
            let b = light.project_back((block + found.stride).as_dvec2(), stored);
            hidden += if light.is_box {
                let sides = (b.min(light.hi) - a.max(light.lo)).max(DVec2::ZERO);
                let whole = light.hi - light.lo;
                sides.x * sides.y / (whole.x * whole.y)
            } else if b.cmple(light.lo).any() || a.cmpge(light.hi).any() {
                0.0
            } else {
                let corners = [a, DVec2::new(b.x, a.y), b, DVec2::new(a.x, b.y)];
                quad_share(light.round, corners.map(|l| light.on_light(l)))
            };
        }
        hidden
    }

    /// `visibility` of `soft/bitmask.wesl`: the samples hidden, and all that lie on the light.
    #[must_use]
    pub fn bitmask(&self, receiver: &Receiver, config: &Bitmask) -> (Mask, Mask) {
        let light = &receiver.light;
        let mut mask = Mask::new(config.samples);
        let mut all = Mask::new(config.samples);
        let sides = light.hi - light.lo;
        for (s, column, row, at) in mask.samples() {
            if light.is_box || light.on_shape(light.on_light(light.lo + sides * at)) {
                all.add_sample(s, column, row);
            }
        }
        if let Some(found) = self.search(light, config.window.budget) {
            let quads = config.occluders.is_quad();
            for block in found.blocks(i32::from(quads)) {
                if quads {
                    self.add_quad(&mut mask, receiver, block, found.stride, config.occluders);
                } else {
                    let close = config.occluders == Occluders::ClosedMicropatch;
                    self.add_patch(&mut mask, receiver, block, found.stride, close);
                }
            }
        }
        (mask, all)
    }

    fn add_patch(&self, mask: &mut Mask, at: &Receiver, block: IVec2, stride: i32, close: bool) {
        let light = &at.light;
        let Some(stored) = self.occluder(at, block, stride) else { return };
        let corner = block.as_dvec2();
        let mut a = light.project_back(corner, stored);
        let b = light.project_back((block + stride).as_dvec2(), stored);
        if close {
            let end = |step: IVec2| {
                let neighbour = self.occluder(at, block - step, stride)?;
                Some(light.project_back(corner, neighbour))
            };
            if let Some(left) = end(IVec2::new(stride, 0)) {
                a.x = a.x.min(left.x);
            }
            if let Some(lower) = end(IVec2::new(0, stride)) {
                a.y = a.y.min(lower.y);
            }
            if let Some(diagonal) = end(IVec2::splat(stride)) {
                a = a.min(diagonal);
            }
        }
        let sides = light.hi - light.lo;
        mask.add_rectangle((a - light.lo) / sides, (b - light.lo) / sides);
    }

    fn add_quad(&self, mask: &mut Mask, at: &Receiver, block: IVec2, stride: i32, kind: Occluders) {
        let light = &at.light;
        let corner = |x: i32, y: i32| {
            let block = block + IVec2::new(x, y) * stride;
            if !self.inside(block + stride / 2) {
                return None;
            }
            let stored = self.occluder(at, block, stride)?;
            let l = light.project_back(block.as_dvec2() + 0.5 * f64::from(stride), stored);
            Some((l - light.lo) / (light.hi - light.lo))
        };
        match [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)] {
            [Some(p), Some(q), Some(r), Some(t)] => {
                if kind == Occluders::Microquad {
                    let [a, b, c, d] = [p, q, r, t].map(|l| l.clamp(DVec2::ZERO, DVec2::ONE));
                    let one = 0.5 * DVec2::new(a.x + d.x, a.y + b.y);
                    let other = 0.5 * DVec2::new(b.x + c.x, d.y + c.y);
                    mask.add_rectangle(one.min(other), one.max(other));
                } else {
                    mask.add_triangle([p, q, r]);
                    mask.add_triangle([p, r, t]);
                }
            }
            corners if kind == Occluders::Microtri => {
                let mut kept = corners.into_iter().flatten();
                if let (Some(a), Some(b), Some(c)) = (kept.next(), kept.next(), kept.next()) {
                    mask.add_triangle([a, b, c]);
                }
            }
            _ => {}
        }
    }
}

impl Search {
    /// The blocks of a search, and `margin` blocks before the first.
    fn blocks(self, margin: i32) -> impl Iterator<Item = IVec2> {
        let Self { lo, hi, stride } = self;
        let from = lo - margin * stride;
        let along = move |from: i32, to: i32| (from..to).step_by(stride as usize);
        along(from.y, hi.y).flat_map(move |y| along(from.x, hi.x).map(move |x| IVec2::new(x, y)))
    }
}

impl Receiver {
    /// `reference` of `common/lookup.wesl`.
    fn reference(&self, texel: IVec2) -> f64 {
        let offset = texel.as_dvec2() + 0.5 - self.light.texel;
        let plane = self.depth + self.gradient.dot(offset);
        (plane + (offset * self.cone).length()).clamp(0.0, 1.0)
    }

    /// `blocks` of `soft/area.wesl`.
    pub(super) fn blocks(&self, texel: IVec2, stored: f64) -> bool {
        stored > self.reference(texel) && stored > self.light.depth
    }
}

fn overlap(block: DVec2, stride: f64, [lo, hi]: [DVec2; 2]) -> f64 {
    let sides = ((block + stride).min(hi) - block.max(lo)).max(DVec2::ZERO);
    sides.x * sides.y
}

/// `tap` of `soft/pcss.wesl`.
#[must_use]
pub fn tap(light: &Seen, i: u32, count: u32, noise: f64) -> DVec2 {
    let u = (f64::from(i) + 0.5) / f64::from(count);
    if light.round {
        let angle = 2.399_963_2 * f64::from(i) + std::f64::consts::TAU * noise;
        return u.sqrt() * DVec2::from_angle(angle);
    }
    let v = f64::from(i.reverse_bits() >> 8) / f64::from(1 << 24);
    let shift = DVec2::new(noise, (noise * 61.754_877_7).fract());
    2.0 * (DVec2::new(u, v) + shift).fract_gl() - 1.0
}
