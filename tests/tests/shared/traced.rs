//! What the texels of a map must hold, traced in f64, and what a sample sees through them.
//!
//! A rasteriser moves corners by up to 1/256 of a texel, so a texel holds what the light sees somewhere within that of the
//! texel's centre: one of several triangles next to an edge. Where every one of them gives the same answer the answer is
//! certain. Next to the edges it may be either.

use std::collections::HashMap;

use antumbra_gpu::{Casters as _, Gpu, read_buffer, read_f32_texture};
use antumbra_map::{Bias, Estimator, FittedView, MapConfig, MapTechnique};
use antumbra_measure::Stage;
use antumbra_scene::Light;
use glam::{DMat4, DVec2, DVec3, DVec4, Vec3};

use super::on_plane::{texel, view_of};

/// How far a rasteriser moves corners, texels: half a step of its grid an axis, and as much again for the transform.
pub(crate) const SNAP: f64 = 1.0 / 256.0;

/// Unit roundoff of f32.
const U: f64 = 1.0 / 16_777_216.0;

/// What a texel may hold: triangles, each with the range of distances at which the light may see it there; and whether it
/// may hold none.
#[derive(Clone, Debug, Default)]
pub(crate) struct Texel {
    pub(crate) seen: Vec<(u32, [f64; 2])>,
    pub(crate) may_be_empty: bool,
}

/// A sample: position, normal, number of its object, bound on its distance from the surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Receiver {
    pub(crate) p: DVec3,
    pub(crate) n: DVec3,
    object: u32,
    error: f64,
}

/// Where a sample looks: what the texels of its kernel may hold, its own first; the view, and its place in it.
pub(crate) struct Lookup {
    pub(crate) texels: Vec<Texel>,
    pub(crate) clip: DMat4,
    pub(crate) at: DVec2,
}

/// The casters, and what the views of a map show of them.
pub(crate) struct Model {
    size: u32,
    triangles: Vec<[DVec3; 3]>,
    objects: Vec<u32>,
    /// For each view, the triangles that are drawn into it.
    drawn: Vec<Vec<u32>>,
    views: Vec<FittedView>,
    /// Position, or direction towards the light.
    pub(crate) light: DVec4,
    /// By how much the texels looked at are off, texels: 0 but in a control.
    aside: f64,
    texels: HashMap<(usize, [i32; 2]), Texel>,
}

impl Model {
    /// Of a map of `size` texels a side, for kernels of `reach` texels around a sample's own.
    pub(crate) fn new(gpu: &Gpu, stage: &Stage, light: &Light, size: u32, reach: u32) -> Self {
        // Its fit says where texels lie.
        let map = MapConfig { size, bias: Bias::ROUNDING, ..MapConfig::default() };
        let estimator = Estimator { radius: 0.5 + reach as f32, ..Estimator::nearest() };
        let mut technique = MapTechnique::new(gpu, &map, estimator).expect("a valid config");
        stage.shoot(gpu, light, &mut technique, 0).expect("a shot");
        let map = technique.map();
        let (positions, indices) = stage.meshes.geometry(gpu).expect("read back");
        let at = |i: u32| positions[i as usize].as_dvec3();
        let listed = stage.meshes.triangles().expect("triangles");
        let bytes = read_buffer(gpu, listed.objects, 4 * u64::from(listed.triangles));
        let frame = stage.frame(light);
        let mut drawn = vec![Vec::new(); map.views().len()];
        let shown = map.views().iter().zip(&mut drawn).filter(|(view, _)| view.clip.is_some());
        for ((_, drawn), view) in shown.zip(map.light_views(&frame)) {
            stage.meshes.ranges(&view, &mut |range| drawn.extend(range));
        }
        Self {
            size,
            triangles: indices.iter().map(|t| t.map(at)).collect(),
            objects: bytemuck::pod_collect_to_vec(&bytes.expect("read back")),
            drawn,
            views: map.views().to_vec(),
            light: map.views()[0].light,
            aside: 0.0,
            texels: HashMap::new(),
        }
    }

    /// As if all texels lay so many texels aside: a control.
    pub(crate) fn moved(self, aside: f64) -> Self {
        Self { aside, texels: HashMap::new(), ..self }
    }

    /// The ray from the light through the place `t` of a view: its beginning before all casters, and its unit direction.
    pub(crate) fn ray(&self, clip: &DMat4, t: DVec2) -> (DVec3, DVec3) {
        let ndc = (2.0 * t / f64::from(self.size) - 1.0) * DVec2::new(1.0, -1.0);
        let near = clip.inverse().project_point3(ndc.extend(1.0));
        if self.light.w == 0.0 {
            (near, -self.light.truncate())
        } else {
            (self.light.truncate(), (near - self.light.truncate()).normalize())
        }
    }

    /// What the texel `at` of a view may hold.
    fn texel(&mut self, view: usize, clip: &DMat4, at: [i32; 2]) -> Texel {
        let at = at.map(|c| c.clamp(0, self.size as i32 - 1));
        if let Some(known) = self.texels.get(&(view, at)) {
            return known.clone();
        }
        let center = DVec2::new(f64::from(at[0]), f64::from(at[1])) + 0.5 + self.aside;
        let ring = |radius: f64| {
            let angle = |k: i32| f64::from(k) * std::f64::consts::FRAC_PI_4;
            (0..8).map(move |k| DVec2::from_angle(angle(k)) * radius)
        };
        // Around the square of side 2 SNAP, whose corners are sqrt 2 away.
        let offsets = ring(SNAP * std::f64::consts::SQRT_2).chain(ring(0.5 * SNAP));
        let mut found = Texel::default();
        for offset in offsets.chain([DVec2::ZERO]) {
            let (origin, direction) = self.ray(clip, center + offset);
            let hits: Vec<(u32, f64)> = self.drawn[view]
                .iter()
                .filter_map(|i| Some((*i, meet(&self.triangles[*i as usize], origin, direction)?)))
                .collect();
            let nearest = hits.iter().map(|h| h.1).fold(f64::INFINITY, f64::min);
            found.may_be_empty |= hits.is_empty();
            // As far as depth may be rounded, over all of the map.
            let rounded = nearest.abs() * 1e-6 + 1e-5;
            for (i, z) in hits.into_iter().filter(|h| h.1 <= nearest + rounded) {
                match found.seen.iter_mut().find(|seen| seen.0 == i) {
                    Some((_, [least, most])) => (*least, *most) = (least.min(z), most.max(z)),
                    None => found.seen.push((i, [z, z])),
                }
            }
        }
        self.texels.insert((view, at), found.clone());
        found
    }

    /// A triangle seen from a sample, its normal, and how far the sample's true place may be; as `map/triangles.wesl`.
    fn seen_from(&self, id: u32, r: &Receiver) -> ([DVec3; 3], DVec3, f64) {
        let t = self.triangles[id as usize];
        let n = (t[1] - t[0]).cross(t[2] - t[0]).normalize_or_zero();
        let largest = |v: DVec3| v.abs().max_element();
        let coordinates = largest(r.p) + t.iter().map(|c| largest(*c)).sum::<f64>();
        (t.map(|c| c - r.p), n, r.error + 8.0 * U * coordinates)
    }

    /// Whether the triangle stands between receiver and light, if that is certain.
    pub(crate) fn blocks(&self, id: u32, r: &Receiver) -> Option<bool> {
        let ([a, b, c], n, tolerance) = self.seen_from(id, r);
        let to_light = self.light.truncate() - self.light.w * r.p;
        let (along, away) = (to_light.dot(n), a.dot(n));
        if away.abs() <= 0.5 * tolerance {
            return Some(false);
        }
        if away.abs() <= 2.0 * tolerance || along.abs() <= 1e-5 * to_light.length() {
            return None;
        }
        let share = away / along;
        if share < 0.0 || (self.light.w > 0.0 && share > 1.0 + 1e-5) {
            return Some(false);
        }
        if self.light.w > 0.0 && share > 1.0 - 1e-5 {
            return None;
        }
        let volume = |a: DVec3, b: DVec3| {
            let v = to_light.dot(a.cross(b));
            let rounding = 8.0 * U * to_light.length() * a.length() * b.length();
            (v.abs() > rounding).then_some(v)
        };
        let volumes = [volume(b, c), volume(c, a), volume(a, b)];
        let known = || volumes.iter().flatten();
        if known().any(|v| *v > 0.0) && known().any(|v| *v < 0.0) {
            return Some(false);
        }
        volumes.iter().all(Option::is_some).then_some(true)
    }

    /// Whether the receiver lies on the triangle, if that is certain.
    fn lies_on(&self, id: u32, r: &Receiver) -> Option<bool> {
        let ([a, b, c], n, tolerance) = self.seen_from(id, r);
        // Inner distances of the edges and the plane: at 0 and above it is on it.
        let inner = |a: DVec3, b: DVec3| (b - a).cross(-a).dot(n) / (b - a).length();
        let least = inner(a, b).min(inner(b, c)).min(inner(c, a)).min(-a.dot(n).abs());
        if n == DVec3::ZERO || least < -2.0 * tolerance {
            return Some(false);
        }
        (least >= -0.5 * tolerance).then_some(true)
    }

    /// Where a kernel of `reach` texels around a sample's own looks; `None` where the light has no map, and for samples of
    /// which rounding may decide the texel.
    pub(crate) fn lookup(&mut self, r: &Receiver, reach: i32) -> Option<Lookup> {
        let view = *view_of(&self.views, r.p)?;
        let index = self.views.iter().position(|v| *v == view)?;
        let clip = view.clip?;
        let at = texel(&clip, r.p, self.size);
        let inner = (at - at.round()).abs().min_element() > 1e-3;
        let within = at.min_element() > 1.0 && at.max_element() < f64::from(self.size) - 1.0;
        if !inner || !within {
            return None;
        }
        let own = [at.x.floor() as i32, at.y.floor() as i32];
        let around = (-reach..=reach).flat_map(|j| (-reach..=reach).map(move |i| [i, j]));
        let mut places: Vec<[i32; 2]> = around.collect();
        places.sort_by_key(|[i, j]| i * i + j * j);
        let texels =
            places.into_iter().map(|[i, j]| self.texel(index, &clip, [own[0] + i, own[1] + j]));
        Some(Lookup { texels: texels.collect(), clip, at })
    }

    /// Whether the sample faces the light, and not all but edge-on.
    pub(crate) fn faces(&self, r: &Receiver) -> bool {
        let to_light = self.light.truncate() - self.light.w * r.p;
        r.n.dot(to_light.normalize()) > 1e-3
    }
}

/// Distance along the ray at which it meets the triangle, from either side.
fn meet([a, b, c]: &[DVec3; 3], origin: DVec3, direction: DVec3) -> Option<f64> {
    let (u, v) = (*b - *a, *c - *a);
    let h = direction.cross(v);
    let det = u.dot(h);
    if det == 0.0 {
        return None;
    }
    let s = origin - *a;
    let q = s.cross(u);
    let (x, y, t) = (s.dot(h) / det, direction.dot(q) / det, v.dot(q) / det);
    (x >= 0.0 && y >= 0.0 && x + y <= 1.0 && t > 0.0).then_some(t)
}

/// Whether one of the texels shows a sample in shadow, if that is certain: `hides` says it of a triangle and of the
/// distances at which the light may see it.
pub(crate) fn any_hides(
    texels: &[Texel],
    hides: impl Fn(u32, &[f64; 2]) -> Option<bool>,
) -> Option<bool> {
    let mut none = true;
    for texel in texels {
        let of: Vec<Option<bool>> = texel.seen.iter().map(|(id, z)| hides(*id, z)).collect();
        if !of.is_empty() && !texel.may_be_empty && of.iter().all(|h| *h == Some(true)) {
            return Some(true);
        }
        none &= of.iter().all(|h| *h == Some(false));
    }
    none.then_some(false)
}

/// Reconstructed triangles, `map/triangle_depth.wesl`: whether the sample is dark, if that is certain.
pub(crate) fn by_triangles(m: &Model, r: &Receiver, at: &Lookup) -> Option<bool> {
    any_hides(&at.texels, |id, _| m.blocks(id, r))
}

/// Object identifiers, `map/object_id.wesl`.
pub(crate) fn by_object(m: &Model, r: &Receiver, at: &Lookup) -> Option<bool> {
    any_hides(&at.texels, |id, _| Some(m.objects[id as usize] != r.object))
}

/// Polygon identifiers, `map/polygon_id.wesl`.
pub(crate) fn by_polygon(m: &Model, r: &Receiver, at: &Lookup) -> Option<bool> {
    let (own, others) = at.texels.split_first()?;
    let is_own = |t: &Texel, is: bool| t.seen.iter().all(|(id, _)| m.lies_on(*id, r) == Some(is));
    // Lit where the sample's own texel shows nothing, or any its triangle.
    let surely = |t: &Texel| !t.may_be_empty && is_own(t, true);
    if is_own(own, true) || (own.seen.is_empty()) || others.iter().any(surely) {
        return Some(false);
    }
    (!own.may_be_empty && at.texels.iter().all(|t| is_own(t, false))).then_some(true)
}

/// The samples of a stage.
pub(crate) fn receivers(gpu: &Gpu, stage: &Stage) -> Vec<Receiver> {
    let read = |texture| read_f32_texture(gpu, texture, 0).expect("read back");
    let (positions, normals) = (read(&stage.samples.positions), read(&stage.samples.normals));
    let vector = |v: &[f32]| Vec3::new(v[0], v[1], v[2]).as_dvec3();
    let pairs = positions.chunks_exact(4).zip(normals.chunks_exact(4));
    pairs
        .map(|(p, n)| Receiver {
            p: vector(p),
            n: vector(n),
            object: (p[3] - 2.0).max(0.0) as u32,
            error: n[3].into(),
        })
        .collect()
}

/// Of the samples of a view that face the light: how many are certain to be lit and to be dark, are not certain, and are
/// not found as they certainly are.
#[derive(Debug, Default)]
pub(crate) struct Count {
    pub(crate) lit: usize,
    pub(crate) dark: usize,
    pub(crate) open: usize,
    pub(crate) wrong: usize,
}

/// Whether a sample is dark, if that is certain.
pub(crate) type Answer = fn(&Model, &Receiver, &Lookup) -> Option<bool>;

/// Compares what was `found` with what must be, kernels of `reach` texels saying by `dark` whether a sample is dark.
pub(crate) fn count(
    model: &mut Model,
    receivers: &[Receiver],
    found: &[f32],
    (reach, dark): (i32, Answer),
) -> Count {
    let mut count = Count::default();
    for (r, v) in receivers.iter().zip(found) {
        let Some(at) = model.lookup(r, reach).filter(|_| model.faces(r)) else { continue };
        let dark = dark(model, r, &at);
        match dark {
            None => count.open += 1,
            Some(true) => count.dark += 1,
            Some(false) => count.lit += 1,
        }
        count.wrong += usize::from(dark.is_some_and(|dark| *v != if dark { 0.0 } else { 1.0 }));
    }
    count
}
