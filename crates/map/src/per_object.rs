//! Maps of their own for single objects.
//!
//! One map around everything that casts spends its texels on the space between casters. Where few objects cast, each gets
//! a map fitted to it alone (Buntin, Stamminger 2007; *Real-Time Shadows* 2.2.5), and a receiver is lit if all maps say
//! so: visibility is the least of theirs. Only casters need to be inside a map, so a map is as large as its object is
//! wide as seen from the light, however far away its shadow falls.
//!
//! More objects than maps share them: the objects are halved by their middles along the longest axis of these, as often as
//! there are maps, so that neighbours share one.

use antumbra_gpu::{CasterBody, Frame, GpuError};
use antumbra_scene::{Bounds, Light};
use antumbra_shaders::{module, source};
use glam::{DVec3, DVec4};

use crate::fit::fit_seen;
use crate::{Arrange, Drawing, Fitting, Layout, Omni, SeenView, Sight};

/// Most maps that a light may have: each is a pass, a layer and a lookup a view sample.
pub const MOST_OBJECT_MAPS: u32 = 64;

/// Arranges a map for each object under directional and spot lights, and as [`Omni`] does under others, which shine all
/// around.
///
/// Objects are the casters' bodies ([`antumbra_gpu::Casters::bodies`]); casters that keep these to themselves share one map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PerObject {
    /// Number of maps, in 1..=[`MOST_OBJECT_MAPS`].
    pub most: u32,
    /// What serves other lights.
    pub omni: Omni,
}

impl PerObject {
    /// Checks the settings.
    ///
    /// # Errors
    /// A number of maps that is out of range.
    pub fn validate(&self) -> Result<(), GpuError> {
        if (1..=MOST_OBJECT_MAPS).contains(&self.most) {
            return Ok(());
        }
        Err(GpuError::Invalid {
            what: "number of object maps",
            value: self.most.to_string(),
            fix: "use 1 to 64, or 0 for one map around all casters",
        })
    }

    /// Whether objects have maps of their own under `light`.
    fn serves(light: &Light) -> bool {
        matches!(light, Light::Directional { .. } | Light::Spot { .. })
    }
}

impl Arrange for PerObject {
    fn layout(&self, light: &Light) -> Layout {
        if !Self::serves(light) {
            return self.omni.layout(light);
        }
        Layout {
            slots: vec![
                module("layout", "map::layout_single"),
                module("map::shadow", "map::shadow_least"),
                source("objects", format!("const COUNT: i32 = {};", self.most)),
            ],
            views: self.most as usize,
            drawing: Drawing::Matrix,
        }
    }

    fn fit(
        &self,
        frame: &Frame<'_>,
        hull: &[DVec3],
        sight: Option<&Sight<'_>>,
        fitting: &Fitting,
    ) -> Result<Vec<SeenView>, GpuError> {
        if !Self::serves(frame.light) {
            return self.omni.fit(frame, hull, sight, fitting);
        }
        let casting = Bounds::of(hull.iter().copied());
        let mut objects = Vec::new();
        frame.casters.bodies(&mut |body: &CasterBody<'_>| {
            if body.can_cast(frame.light) && !body.bounds.is_empty() {
                objects.push(body.bounds);
            }
        });
        if objects.is_empty() && !casting.is_empty() {
            objects.push(casting);
        }
        let mut views = Vec::with_capacity(self.most as usize);
        for group in shared(&mut objects, self.most as usize) {
            let bounds = group.iter().fold(Bounds::EMPTY, |all, b| all.union(*b));
            let corners: Vec<DVec3> = group.iter().flat_map(Bounds::corners).collect();
            let casters: Vec<Bounds> = sight
                .iter()
                .flat_map(|sight| sight.casters)
                .map(|b| Bounds { min: b.min.max(bounds.min), max: b.max.min(bounds.max) })
                .filter(|b| !b.is_empty())
                .collect();
            let sight = sight.map(|sight| Sight { region: sight.region, casters: &casters });
            for mut view in fit_seen(frame.light, &corners, sight.as_ref(), fitting)? {
                // Others are drawn in their own maps; but where maps are averaged, all that receives is drawn in each.
                if !fitting.receivers {
                    view.volume.extend(half_spaces(&bounds, frame.origin));
                }
                views.push(view);
            }
        }
        let light = match (views.first(), frame.light) {
            (Some(view), _) => view.view.light,
            (None, Light::Directional { direction, .. }) => (-direction.normalize()).extend(0.0),
            (None, light) => (light.position().unwrap_or(frame.origin) - frame.origin).extend(1.0),
        };
        let empty = crate::FittedView { clip: None, light };
        views.resize(self.most as usize, SeenView::whole(empty));
        Ok(views)
    }
}

/// `objects` in at most `count` groups of neighbours; as many as there are objects where that is fewer.
fn shared(objects: &mut [Bounds], count: usize) -> Vec<&[Bounds]> {
    if objects.is_empty() {
        return Vec::new();
    }
    if count <= 1 || objects.len() == 1 {
        return vec![&*objects];
    }
    let spread = Bounds::of(objects.iter().map(Bounds::center));
    let axis = (spread.max - spread.min).max_position();
    objects.sort_by(|a, b| a.center()[axis].total_cmp(&b.center()[axis]));
    // As many objects as maps on either side, where there are few objects; else half of each.
    let low = count / 2;
    let at =
        if objects.len() <= count { low.min(objects.len() - 1).max(1) } else { objects.len() / 2 };
    let (first, last) = objects.split_at_mut(at);
    let mut groups = shared(first, low.max(1));
    groups.extend(shared(last, count - low));
    groups
}

/// The half-spaces of a box (world space), widened by what rounding moves its corners; relative to `origin`.
fn half_spaces(bounds: &Bounds, origin: DVec3) -> [DVec4; 6] {
    let (min, max) = (bounds.min - origin, bounds.max - origin);
    // Boxes and planes are f64: 2^-40 of the coordinates is far above their rounding.
    let pad = min.abs().max(max.abs()).max_element() * (-40_f64).exp2();
    let low = [0, 1, 2].map(|i| DVec3::AXES[i].extend(pad - min[i]));
    let high = [0, 1, 2].map(|i| (-DVec3::AXES[i]).extend(pad + max[i]));
    [low[0], low[1], low[2], high[0], high[1], high[2]]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64, z: f64) -> Bounds {
        let min = DVec3::new(x, 0.0, z);
        Bounds { min, max: min + DVec3::ONE }
    }

    #[test]
    fn few_objects_have_maps_of_their_own_and_many_share_them_with_neighbours() {
        let few: Vec<Bounds> = (0..5).map(|i| at(7.0 * f64::from(i * 3 % 5), 0.0)).collect();
        for count in [5, 8, 64] {
            let mut objects = few.clone();
            let groups = shared(&mut objects, count);
            assert_eq!(groups.len(), 5, "{count} maps");
            assert!(groups.iter().all(|group| group.len() == 1), "{count} maps");
        }
        let many: Vec<Bounds> =
            (0..100).map(|i| at(f64::from(i % 10) * 3.0, f64::from(i / 10) * 3.0)).collect();
        for count in [1, 2, 3, 8] {
            let mut objects = many.clone();
            let groups = shared(&mut objects, count);
            assert_eq!(groups.len(), count, "groups");
            assert_eq!(groups.iter().map(|g| g.len()).sum::<usize>(), 100, "no object is lost");
        }
        assert!(shared(&mut [], 8).is_empty(), "no objects, no maps");
    }

    #[test]
    fn the_half_spaces_of_a_box_hold_its_corners_and_little_more() {
        let (bounds, origin) = (at(1e5, -3.0), DVec3::new(1e5, 1.0, 2.0));
        let planes = half_spaces(&bounds, origin);
        let side = |p: DVec3| {
            let p = p - origin;
            planes.iter().map(|v| v.truncate().dot(p) + v.w).fold(f64::INFINITY, f64::min)
        };
        assert!(bounds.corners().into_iter().all(|c| side(c) >= 0.0), "corners");
        assert!(side(bounds.min - 1e-6) < 0.0 && side(bounds.max + 1e-6) < 0.0, "beyond");
    }
}
