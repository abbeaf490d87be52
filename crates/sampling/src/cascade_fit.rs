//! Fits the views of cascades.
//!
//! A steady window is bit for bit that of the frame before, or its texels are: its scale follows from the depths of
//! its slice alone, and its border from the frame's origin in whole texels, so that the matrix's translation is a
//! multiple of the texel's size that f32 holds exactly.

use antumbra_gpu::Frame;
use antumbra_map::{FittedView, Fitting, SeenView, Sight, basis};
use antumbra_scene::Bounds;
use glam::{DMat3, DMat4, DVec3, DVec4};

use crate::warp_fit::{Shine, warped};
use crate::{CascadeFit, Cascades, Eye, Rule, Select};

/// What all cascades of a frame share.
pub(crate) struct Slices<'a> {
    settings: &'a Cascades<()>,
    frame: &'a Frame<'a>,
    sight: &'a Sight<'a>,
    fitting: &'a Fitting,
    eye: Eye,
    to_light: DVec3,
    /// Rows: right, up, towards the light.
    basis: DMat3,
    /// Extents of all casters along the rows.
    casters: [(f64, f64); 3],
    /// Where the last receiver lies along the light, seen or not.
    last: f64,
    /// What casters and receivers share of the light's plane, seen or not.
    shared: [(f64, f64); 2],
    /// Ends of the slices.
    depths: Vec<f64>,
    /// Least half width of a window, metres.
    least: f64,
    /// Metres across a metre along the light that an estimator looks aside ([`antumbra_map::Arrange::spread`]).
    spread: f64,
    /// The longest way along the light within the box around all that casts or receives, metres.
    way: f64,
}

/// Slices reach farther than their ends by this share of their depths, which is more than f32 makes of a depth.
const PAD: f64 = 1e-4;

/// A range of depths is widened to the next power of 2^(1/8), so that it does not creep with the camera.
const STEPS: f64 = 8.0;

/// A view without casters; `light` is what the shader gets.
pub(crate) fn no_view(light: DVec4) -> SeenView {
    SeenView { view: FittedView { clip: None, light }, volume: Vec::new(), ends: None }
}

/// The half-spaces of a view's window, metres; those of a window without an end are none.
pub(crate) fn window_planes(clip: &DMat4) -> Vec<DVec4> {
    let [x, y, w] = [0, 1, 3].map(|i| clip.row(i));
    [w + x, w - x, w + y, w - y]
        .into_iter()
        .map(|plane| plane / plane.truncate().length())
        .filter(|plane| plane.is_finite())
        .collect()
}

pub(crate) fn span(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)))
}

/// `size` or the next larger power of 2^(1 / [`STEPS`]); sizes that differ by rounding give the same.
fn stepped(size: f64) -> f64 {
    ((size.log2() * STEPS - 1e-6).ceil() / STEPS).exp2()
}

impl<'a> Slices<'a> {
    /// `None` where nothing can be shadowed or it is not known what is seen.
    pub(crate) fn new(
        settings: &'a Cascades<()>,
        frame: &'a Frame<'a>,
        hull: &[DVec3],
        eye: Eye,
        sight: &'a Sight<'a>,
        fitting: &'a Fitting,
        spread: f64,
    ) -> Option<Self> {
        let to_light = frame.light.towards(frame.origin, glam::DVec2::splat(0.5)).normalize();
        let basis = basis(to_light);
        let points: Vec<DVec3> = hull.iter().map(|p| *p - fitting.origin).collect();
        if points.is_empty() {
            return None;
        }
        let along = |points: &[DVec3], i: usize| span(points.iter().map(|p| basis.row(i).dot(*p)));
        let casters = [0, 1, 2].map(|i| along(&points, i));
        let (mut all, mut nearest) = (Bounds::EMPTY, f64::INFINITY);
        let place = eye.position + fitting.origin;
        let known = frame.casters.bodies(&mut |body| {
            all = all.union(body.bounds);
            for part in body.parts {
                nearest = nearest.min(place.clamp(part.min, part.max).distance(place));
            }
        });
        if !known || all.is_empty() {
            return None;
        }
        let receivers = all.corners().map(|p| p - fitting.origin);
        let seen: Vec<DVec3> = sight.region.corners().collect();
        if seen.is_empty() {
            return None;
        }
        let (near, far) = match settings.fit {
            // Wherever it looks, the camera sees nothing farther than the farthest receiver is from it, and nothing
            // at a smaller depth than the nearest receiver has in the picture's corner. The far end goes in small
            // steps; the near one, which moves as one walks past things, in powers of 2.
            CascadeFit::Steady => {
                let far = receivers.iter().map(|p| p.distance(eye.position)).fold(0.0, f64::max);
                let corner = eye.corners.iter().map(|c| c.length()).fold(1.0, f64::max);
                let near = ((nearest / corner).log2() + 1e-6).floor().exp2();
                (eye.near.max(near), stepped(far).min(eye.far))
            }
            CascadeFit::Tight | CascadeFit::Warped => {
                let (near, far) = span(seen.iter().map(|p| eye.depth(*p)));
                (near.max(eye.near), far.min(eye.far))
            }
        };
        let far = far.max(near) * (1.0 + PAD);
        let extent = casters.iter().map(|a| a.1 - a.0).fold(0.0, f64::max);
        let farthest = points.iter().map(|p| p.length()).fold(0.0, f64::max);
        let shared = [0, 1].map(|i| {
            let r = along(&receivers, i);
            (casters[i].0.max(r.0), casters[i].1.min(r.1))
        });
        let (last, _) = along(&receivers, 2);
        Some(Self {
            last,
            spread,
            way: ((all.max - all.min) / to_light.abs()).min_element().min(f64::from(f32::MAX)),
            settings,
            frame,
            sight,
            fitting,
            eye,
            to_light,
            basis,
            casters,
            shared,
            depths: settings.splits.ends(near, far, settings.count),
            // As for a single map: 16 steps of f32 coordinates.
            least: (extent.max(farthest) * 2f64.powi(-20)).max(f64::from(f32::MIN_POSITIVE)),
        })
    }

    /// One view for each cascade.
    pub(crate) fn views(&self) -> Vec<SeenView> {
        let light = self.to_light.extend(0.0);
        let mut windows: Vec<_> =
            (0..self.settings.count as usize).map(|i| self.windows(i)).collect();
        if self.settings.select == Select::Map && self.settings.fit == CascadeFit::Steady {
            self.tile(&mut windows);
        }
        let mut views: Vec<SeenView> = Vec::new();
        for (i, windows) in windows.iter().enumerate() {
            let view = windows.as_ref().and_then(|windows| self.view(i, windows)).filter(|view| {
                // By map, the first of two with the same window answers for both.
                let same = |v: &SeenView| v.view.clip == view.view.clip;
                self.settings.select == Select::Depth || !views.iter().any(same)
            });
            views.push(view.unwrap_or_else(|| no_view(light)));
        }
        views
    }

    /// What the shader selects by, as `sampling/cascade_by_*.wesl` says.
    pub(crate) fn ends(&self) -> Vec<DVec4> {
        let blend = f64::from(self.settings.blend);
        match self.settings.select {
            Select::Map => {
                let border =
                    1.0 - 2.0 * f64::from(self.fitting.guard) / f64::from(self.fitting.size);
                let band = (blend * border).max(1e-6);
                vec![DVec4::new(border, 1.0 / band, self.spread, self.way)]
            }
            Select::Depth => {
                let end = |ends: &[f64]| {
                    let band = (blend * (ends[1] - ends[0])).max(1e-6 * ends[1]);
                    self.eye.half_space(ends[1], false) / band
                };
                self.depths.windows(2).map(end).collect()
            }
        }
    }

    /// The depths of slice `i` and, where depth decides, of the part before it that shades over into it.
    fn slice(&self, i: usize) -> (f64, f64) {
        let ends = &self.depths;
        let before = match self.settings.select {
            Select::Depth if i > 0 => f64::from(self.settings.blend) * (ends[i] - ends[i - 1]),
            _ => 0.0,
        };
        ((ends[i] - before) * (1.0 - PAD), ends[i + 1] * (1.0 + PAD))
    }

    /// The half-spaces of slice `i`.
    fn cone(&self, i: usize) -> [DVec4; 2] {
        let (near, far) = self.slice(i);
        [self.eye.half_space(near, true), self.eye.half_space(far, false)]
    }

    fn windows(&self, i: usize) -> Option<[Window; 2]> {
        let (near, far) = self.slice(i);
        match self.settings.fit {
            CascadeFit::Steady => self.steady(near, far),
            CascadeFit::Tight | CascadeFit::Warped => self.tight(&self.cone(i)),
        }
    }

    fn view(&self, i: usize, windows: &[Window; 2]) -> Option<SeenView> {
        let ((near, far), slice) = (self.slice(i), self.cone(i));
        let uniform = self.matrix(windows);
        let clip = match self.settings.fit {
            CascadeFit::Warped => {
                let shine = Shine::Parallel { to_light: self.to_light, depths: self.depth_range() };
                let (light, rule) = (self.frame.light, Rule::default());
                warped(light, shine, &slice, &self.eye, self.sight, self.fitting, &rule, true)
                    .filter(|warped| warped.is_better_than(&uniform))
                    .map_or(uniform, |warped| warped.clip)
            }
            CascadeFit::Steady | CascadeFit::Tight => uniform,
        };
        // A cascade that answers for all it holds needs the casters of all that, not of its slice alone.
        let cone = match self.settings.select {
            Select::Map => window_planes(&clip),
            Select::Depth => slice.to_vec(),
        };
        let texel = windows.iter().map(|w| w.texel).fold(0.0, f64::max);
        // A warped texel is longer than a uniform one by less than the ratio of the slice's depths.
        let texel = if clip == uniform { texel } else { texel * far / near };
        let needed = self.sight.needed(self.frame.light, &cone, |_| texel, self.fitting)?;
        let view = FittedView { clip: Some(clip), light: self.to_light.extend(0.0) };
        let (near, far) = self.depth_range();
        let (last_caster, _) = self.casters[2];
        let ends = [near, last_caster, far].map(|z| self.basis.row(2) * z);
        let ends = (clip == uniform).then_some(ends);
        Some(SeenView { view, volume: needed.volume, ends })
    }

    /// The window around the sphere of a slice, or around all that can be shadowed where that is less.
    fn steady(&self, near: f64, far: f64) -> Option<[Window; 2]> {
        let (center, radius) = self.eye.sphere(near, far);
        let usable = self.fitting.usable();
        let mut windows = [Window::default(); 2];
        for (i, window) in windows.iter_mut().enumerate() {
            let (lo, hi) = self.shared[i];
            if lo > hi {
                return None;
            }
            let texel = stepped((2.0 * radius).max(2.0 * self.least) / usable);
            *window = self.window(i, self.basis.row(i).dot(center) - radius, texel);
        }
        Some(windows)
    }

    /// Cascades whose window is that around all that can be shadowed are as many maps as there are of the same: they
    /// share its area out instead. Its tiles are where the scene is, and no camera moves them. A cascade before them that
    /// is no finer than a tile takes part.
    fn tile(&self, windows: &mut [Option<[Window; 2]>]) {
        let coarser = |window: &Option<[Window; 2]>, grid: [usize; 2]| {
            // Texels go by steps, of which a tile's may be one: rounding does not decide then.
            let texel = |i: usize| self.part(i, 0, grid).texel * (1.0 - 1e-9);
            window.is_some_and(|w| w[0].texel >= texel(0) && w[1].texel >= texel(1))
        };
        let Some(mut first) = windows.iter().position(|w| coarser(w, [1, 1])) else { return };
        let lengths = self.shared.map(|(from, to)| to - from);
        while first > 0 && coarser(&windows[first - 1], tiles(lengths, windows.len() - first)) {
            first -= 1;
        }
        let grid = tiles(lengths, windows.len() - first);
        for (k, window) in windows[first..].iter_mut().enumerate() {
            let (column, row) = (k % grid[0], k / grid[0]);
            let part = || [self.part(0, column, grid), self.part(1, row, grid)];
            *window = (row < grid[1]).then(part);
        }
    }

    /// Along row `i` of the basis, the window around part `k` of the `grid[i]` equal ones of all that can be shadowed. Beyond
    /// one of several parts there is more, at which estimators look from all of it.
    fn part(&self, i: usize, k: usize, grid: [usize; 2]) -> Window {
        let (from, to) = self.shared[i];
        let length = (to - from) / grid[i] as f64;
        let (near, far) = self.depth_range();
        let beyond = if grid == [1, 1] { 0.0 } else { self.spread * self.way.min(near - far) };
        let texel = (length + 2.0 * beyond).max(2.0 * self.least) / self.fitting.usable();
        let middle = from + (k as f64 + 0.5) * length;
        Window { left: middle - 0.5 * f64::from(self.fitting.size) * texel, texel }
    }

    /// The window around what is seen in a slice and may be shadowed.
    fn tight(&self, slice: &[DVec4]) -> Option<[Window; 2]> {
        let along = |points: &[DVec3], i| span(points.iter().map(|p| self.basis.row(i).dot(*p)));
        let widest = |points: &[DVec3]| {
            let extents = [0, 1].map(|i| along(points, i)).map(|a| a.1 - a.0);
            stepped(extents[0].max(extents[1]).max(2.0 * self.least) / self.fitting.usable())
        };
        let needed = self.sight.needed(self.frame.light, slice, widest, self.fitting)?;
        let mut windows = [Window::default(); 2];
        for (i, window) in windows.iter_mut().enumerate() {
            let (c, r) = (along(&needed.casters, i), along(&needed.receivers, i));
            let (lo, hi) = (c.0.max(r.0), c.1.min(r.1));
            if lo > hi {
                return None;
            }
            let texel = stepped((hi - lo).max(2.0 * self.least) / self.fitting.usable());
            *window = self.window(i, lo, texel);
        }
        Some(windows)
    }

    /// Along row `i` of the basis, the window of such texels whose guard band ends within one before `lo`, on a grid from
    /// the origin; or that around all that can be shadowed, which no camera changes, where it is no wider.
    fn window(&self, i: usize, lo: f64, texel: f64) -> Window {
        let all = self.part(i, 0, [1, 1]);
        if texel >= all.texel {
            return all;
        }
        Window { left: self.fitting.left(lo / texel) * texel, texel }
    }

    /// Depths, along the light, of the near and the far end: those of all casters, so that none is lost however far
    /// from the view, and of no camera. Where receivers are drawn too, those of all receivers behind, but no more than as
    /// far again or as wide.
    fn depth_range(&self) -> (f64, f64) {
        let (mut lo, hi) = self.casters[2];
        if self.fitting.receivers {
            let beyond = self.shared.iter().map(|a| a.1 - a.0).fold(hi - lo, f64::max);
            lo = self.last.clamp(lo - beyond, lo);
        }
        let pad = (hi - lo) * 2f64.powi(-12) + self.least;
        (hi + pad, lo - pad)
    }

    fn matrix(&self, windows: &[Window; 2]) -> DMat4 {
        let size = f64::from(self.fitting.size);
        let (near, far) = self.depth_range();
        let [x, y] = windows.map(|w| {
            // The border in texels is a whole number, of which this loses nothing.
            (2.0 / (size * w.texel), -(2.0 * (w.left / w.texel) + size) / size)
        });
        let scale = DVec3::new(x.0, y.0, 1.0 / (near - far));
        let shift = DVec3::new(x.1, y.1, -far / (near - far));
        DMat4::from_mat3_translation(DMat3::from_diagonal(scale) * self.basis, shift)
    }
}

/// Columns and rows of `most` tiles or fewer of an area with sides of these lengths, that make the longer side of a tile
/// as short as it gets.
fn tiles(lengths: [f64; 2], most: usize) -> [usize; 2] {
    let mut grid = [1, 1];
    loop {
        let side = |i: usize| lengths[i] / grid[i] as f64;
        let mut next = grid;
        next[usize::from(side(1) > side(0))] += 1;
        if next[0] * next[1] > most {
            return grid;
        }
        grid = next;
    }
}

/// A window along one axis of the light's plane.
#[derive(Clone, Copy, Debug, Default)]
struct Window {
    /// Its lower border, metres.
    left: f64,
    /// Side of a texel, metres.
    texel: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_as_short_as_their_number_allows() {
        for (lengths, most, expected) in [
            ([1.0, 1.0], 1, [1, 1]),
            ([1.0, 1.0], 2, [2, 1]),
            ([1.0, 1.0], 3, [2, 1]),
            ([1.0, 1.0], 4, [2, 2]),
            ([1.0, 1.0], 8, [3, 2]),
            ([4.0, 1.0], 4, [4, 1]),
            ([1.0, 3.0], 8, [2, 4]),
            ([0.0, 0.0], 4, [4, 1]),
        ] {
            assert_eq!(tiles(lengths, most), expected, "{most} of {lengths:?}");
        }
    }
}
