//! The maps of triangles, the map in spans and the plain map, against what their texels must hold, without an exception.

use antumbra_gpu::TechniqueConfig;
use antumbra_map::{MapConfig, ObjectId, Plain, PolygonId, ScanLines, TriangleDepth};
use antumbra_measure::Stage;
use antumbra_scene::generate::shapes;
use antumbra_scene::{Camera, Light, LightKind, Scene};
use antumbra_tests::gpu;
use glam::{DAffine3, DVec2, DVec3};

use crate::shared::traced;

use traced::{
    Answer, Lookup, Model, Receiver, SNAP, any_hides, by_object, by_polygon, by_triangles, count,
    receivers,
};

const VIEW: u32 = 160;
const MAP: u32 = 256;

/// The plain comparison, by depth that may be `tolerance` farther than what is there: a share of the range in parallel
/// light, of the distance elsewhere.
fn by_depth(m: &Model, r: &Receiver, at: &Lookup, tolerance: f64) -> Option<bool> {
    let center = at.at.floor() + 0.5;
    let (origin, direction) = m.ray(&at.clip, center);
    let met = |(o, d): (DVec3, DVec3)| o + d * (r.n.dot(r.p - o) / r.n.dot(d));
    let q = met((origin, direction));
    let plane = (q - origin).length();
    let slope = (r.n.dot(direction).powi(-2) - 1.0).max(0.0).sqrt();
    let across = |q: DVec3, p: DVec3| (q - p).reject_from_normalized(direction).length();
    // The cone of slope 2, wider where the light grazes the receiver (`common/lookup.wesl`).
    let steep = slope.max(1.0);
    let rise = (steep + steep.recip()) * across(q, r.p);
    let stored = match m.light.w {
        0.0 => tolerance / at.clip.row(2).truncate().length(),
        _ => tolerance * plane,
    };
    // What the snap moves, to either side of an axis.
    let side = [DVec2::X, DVec2::Y].map(|step| across(met(m.ray(&at.clip, center + step)), q));
    let snapped = 2.0 * SNAP * slope * (side[0] + side[1]);
    let rounding = 1e-6 * plane.abs() + 1e-5;
    // Across the light and across the map's axes differ in perspective, by the cosine of 45 degrees at most.
    let cosine = std::f64::consts::FRAC_1_SQRT_2;
    let (least, most) = (cosine * rise - rounding, rise / cosine + stored + snapped + rounding);
    any_hides(&at.texels, |_, [near, far]| {
        let (lowest, highest) = (plane - far, plane - near);
        if lowest > most { Some(true) } else { (highest < least).then_some(false) }
    })
}

/// A technique over a map of the traced kind: its name, the texels around its own, a side, at which it looks, and whether a
/// sample is dark, if that is certain.
type Traced = (&'static str, Box<dyn TechniqueConfig>, i32, Answer);

fn techniques() -> Vec<Traced> {
    let map = MapConfig { size: MAP, ..MapConfig::default() };
    let depth = |reach| Box::new(TriangleDepth { size: MAP, reach });
    let polygon = |reach| Box::new(PolygonId { size: MAP, reach });
    let spans = ScanLines { map, ..ScanLines::default() };
    vec![
        ("triangle-depth", depth(0), 0, by_triangles),
        ("triangle-depth, reach 1", depth(1), 1, by_triangles),
        ("polygon-id", polygon(0), 0, by_polygon),
        ("polygon-id, reach 1", polygon(1), 1, by_polygon),
        ("object-id", Box::new(ObjectId { size: MAP }), 0, by_object),
        ("plain", Box::new(Plain { map }), 0, |m, r, at| by_depth(m, r, at, 0.0)),
        ("scan-lines", Box::new(spans), 0, |m, r, at| by_depth(m, r, at, 2f64.powi(-16))),
    ]
}

/// Creases, contacts, bodies above each other, and a ball of triangles not much larger than a texel.
fn scene() -> Scene {
    let mut scene = Scene::default();
    scene.add(shapes::floor(4.0), DAffine3::IDENTITY);
    let half = DVec3::new(0.5, 0.4, 0.7);
    let standing = shapes::cuboid(-half.with_y(0.0), half.with_y(0.8));
    scene.add(standing, DAffine3::from_rotation_y(0.4));
    let placed = |at: DVec3| DAffine3::from_translation(at) * DAffine3::from_rotation_x(0.5);
    scene.add(shapes::tetrahedron(0.7), placed(DVec3::new(-1.3, 1.1, 0.4)));
    scene.add(shapes::cuboid(-half, half), placed(DVec3::new(0.9, 1.6, -0.8)));
    let ball = shapes::icosphere(1, 0.5);
    scene.add(ball, DAffine3::from_translation(DVec3::new(0.9, 0.6, 1.2)));
    scene
}

fn camera() -> Camera {
    let (eye, target) = (DVec3::new(2.0, 3.0, 3.2), DVec3::new(0.0, 0.7, 0.0));
    Camera { eye, target, up: DVec3::Y, fov_y: 0.8, near: 0.1 }
}

#[test]
fn every_sample_sees_what_the_texels_must_hold() {
    let gpu = gpu();
    let scene = scene();
    let stage = Stage::new(&gpu, &scene, camera(), VIEW, VIEW).expect("a stage");
    let receivers = receivers(&gpu, &stage);
    for kind in [LightKind::Directional, LightKind::Spot, LightKind::Point] {
        let light = match kind {
            LightKind::Directional => Light::sun(0.6, 0.9, 0.0),
            _ => scene.place_light(kind),
        };
        for reach in [0, 1] {
            let model = || Model::new(&gpu, &stage, &light, MAP, reach as u32);
            // The control: texels as far aside as the widest kernel does not reach.
            let (mut model, mut moved) = (model(), model().moved(3.0));
            for (name, config, _, dark) in techniques().into_iter().filter(|t| t.2 == reach) {
                let mut technique = config.build(&gpu).expect("a valid config");
                let shot = stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot");
                let compare = |model| count(model, &receivers, &shot.visibility, (reach, dark));
                let (right, off) = (compare(&mut model), compare(&mut moved));
                let what = format!("{kind:?}, {name}: {right:?}, three texels aside {off:?}");
                assert_eq!(right.wrong, 0, "{what}");
                assert!(right.dark > 300 && right.lit > 3000, "{what}");
                assert!(10 * right.open < right.dark + right.lit, "{what}");
                assert!(off.wrong > 100, "{what}");
            }
        }
    }
}
