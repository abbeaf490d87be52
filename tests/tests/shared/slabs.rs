//! Level slabs over a floor under an overhead sun: windows of depths whose leaks have closed forms.

use antumbra_filter::{Prefilter, Shape};
use antumbra_gpu::{Gpu, TechniqueConfig};
use antumbra_map::{Bias, MapConfig};
use antumbra_measure::Stage;
use antumbra_reference::ViewSample;
use antumbra_scene::generate::shapes;
use antumbra_scene::{Light, Scene};
use glam::{DAffine3, DVec3, Vec3};

/// Height of the floor, metres.
pub(crate) const FLOOR: f64 = 3.0;

/// Slabs by height and the range of x that each covers.
pub(crate) fn slabs(layers: &[(f64, f64, f64)]) -> Scene {
    let mut scene = Scene::default();
    // It shadows nothing, so it is culled and not in the map.
    scene.add(shapes::floor(8.0), DAffine3::from_translation(FLOOR * DVec3::Y));
    for (y, from, to) in layers {
        let center = DVec3::new(0.5 * (from + to), *y, 0.0);
        let half = 0.5 * (to - from);
        scene.add(shapes::quad(center, 5.0 * DVec3::Z, half * DVec3::X), DAffine3::IDENTITY);
    }
    scene
}

/// The sun overhead.
pub(crate) fn overhead() -> Light {
    Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 }
}

/// Where `across` looks, along x.
pub(crate) fn places() -> impl Iterator<Item = f64> {
    (0..1024).map(|i| (f64::from(i) + 0.5) / 1024.0 * 0.8 - 0.4)
}

/// Visibility of floor points along x in (-0.4, 0.4), through a map of 512.
pub(crate) fn across(gpu: &Gpu, scene: &Scene, config: &dyn TechniqueConfig) -> Vec<f32> {
    let points: Vec<ViewSample> = places()
        .map(|x| {
            let position = DVec3::new(x, FLOOR, 0.013) - scene.origin();
            ViewSample { position: position.as_vec3(), normal: Vec3::Y }
        })
        .collect();
    let stage = Stage::at_points(gpu, scene, &points).expect("a stage");
    let mut technique = config.build(gpu).expect("a valid config");
    let mut shot = stage.shoot(gpu, &overhead(), technique.as_mut(), 0).expect("a shot");
    shot.visibility.truncate(1024);
    shot.visibility
}

/// Kernels of 17 texels, and no cone: the receiver's own depth.
pub(crate) fn settings() -> (MapConfig, Prefilter) {
    let bias = Bias { cone: 0.0, ..Bias::default() };
    (
        MapConfig { size: 512, bias, ..MapConfig::default() },
        Prefilter { shape: Shape::Box, radius: 8, ..Prefilter::default() },
    )
}
