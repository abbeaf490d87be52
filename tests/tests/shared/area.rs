//! Stages of area lights: bodies, a plate whose shadow has a closed form, sheets below a square light.

use antumbra::Config;
use antumbra_gpu::{Counters, Gpu};
use antumbra_map::MapConfig;
use antumbra_measure::Stage;
use antumbra_reference::ViewSample;
use antumbra_reference::closed::{self, Occluder};
use antumbra_reference::penumbra_width;
use antumbra_scene::{Light, Scene, generate};
use glam::{DAffine3, DVec3, Vec3};

/// A map of that side.
pub(crate) fn map(size: u32) -> MapConfig {
    MapConfig { size, ..MapConfig::default() }
}

/// Visibility by a technique made for it.
pub(crate) fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, config: &Config) -> Vec<f32> {
    let mut technique = config.build(gpu).expect("a valid config");
    stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot").visibility
}

/// As [`shoot`], again and again by one technique, with its counters.
pub(crate) fn shots<'a>(
    gpu: &Gpu,
    config: &Config,
    all: impl IntoIterator<Item = (&'a Stage, &'a Light)>,
) -> Vec<(Vec<f32>, Counters)> {
    let mut technique = config.build(gpu).expect("a valid config");
    let mut shot = |(stage, light): (&Stage, &Light)| {
        let shot = stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot");
        (shot.visibility, shot.counters)
    };
    all.into_iter().map(&mut shot).collect()
}

/// Lights of each kind that may have an extent, of half size `half`, above the origin.
pub(crate) fn lights(half: f64) -> Vec<Light> {
    let center = DVec3::new(0.4, 5.0, -0.3);
    let tilt = DVec3::new(0.2, 0.1, 1.0).normalize();
    let across = DVec3::new(1.0, 0.0, -0.2).normalize();
    vec![
        Light::Directional {
            direction: DVec3::new(0.3, -1.0, 0.2).normalize(),
            angular_diameter: 2.0 * (half / 5.0).atan(),
        },
        Light::Sphere { center, radius: half },
        Light::Rect {
            center,
            half_u: across * half,
            half_v: across.cross(tilt).cross(across) * half,
        },
        Light::Rect { center, half_u: DVec3::X * half, half_v: DVec3::Z * half },
        Light::Disc { center, radius: half, axis_u: DVec3::X, axis_v: DVec3::Z },
    ]
}

/// A box, a ball and a sheet above a floor.
pub(crate) fn bodies() -> Scene {
    let mut scene = Scene { name: "bodies".to_owned(), ..Scene::default() };
    scene.add(generate::shapes::floor(5.0), DAffine3::IDENTITY);
    let cuboid = generate::shapes::cuboid(DVec3::new(-1.5, 0.0, -0.5), DVec3::new(-0.5, 1.0, 0.5));
    scene.add(cuboid, DAffine3::IDENTITY);
    let ball = generate::shapes::icosphere(3, 0.5);
    scene.add(ball, DAffine3::from_translation(DVec3::new(1.0, 1.2, 0.5)));
    let sheet = generate::shapes::quad(DVec3::new(0.0, 2.0, 0.0), DVec3::X * 0.6, DVec3::Z * 0.3);
    scene.add(sheet, DAffine3::IDENTITY);
    scene
}

/// Mean, and its standard error were the values independent.
pub(crate) fn mean(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (mean, (squares / (count - 1.0) / count).sqrt())
}

/// What the scene's camera sees.
pub(crate) fn seen(gpu: &Gpu, scene: &Scene, side: u32) -> Stage {
    Stage::new(gpu, scene, scene.camera_or_framing(), side, side).expect("a stage")
}

/// A plate over a floor, and samples on a line across one edge of its shadow.
pub(crate) struct Plate {
    stage: Stage,
    along: Vec<f64>,
    truth: Vec<f32>,
    light: Light,
}

/// A plate x in [-2, 0], |z| <= 2 at `height` under `light`.
pub(crate) fn plate(gpu: &Gpu, light: Light, height: f64) -> Plate {
    let center = DVec3::new(-1.0, height, 0.0);
    let (half_u, half_v) = (DVec3::Z * 2.0, DVec3::X);
    let mut scene = Scene { name: "plate".to_owned(), ..Scene::default() };
    scene.add(generate::shapes::floor(4.0), DAffine3::IDENTITY);
    scene.add(generate::shapes::quad(center, half_u, half_v), DAffine3::IDENTITY);
    let occluder = Occluder::rectangle(center, half_u, half_v);
    let along: Vec<f64> = (0..256).map(|i| -1.2 + f64::from(i) * 2.4 / 255.0).collect();
    let origin = scene.origin();
    let mut samples = Vec::new();
    let mut truth = Vec::new();
    for (i, x) in along.iter().enumerate() {
        let p = DVec3::new(*x, 0.0, 0.013 * (i % 7) as f64);
        let position = (p - origin).as_vec3();
        samples.push(ViewSample { position, normal: Vec3::Y });
        truth.push(closed::visibility(&occluder, &light, position.as_dvec3() + origin) as f32);
    }
    let stage = Stage::at_points(gpu, &scene, &samples).expect("a stage");
    Plate { stage, along, truth, light }
}

impl Plate {
    /// Root of the mean square error, and relative error of the penumbra's width.
    pub(crate) fn errors(&self, gpu: &Gpu, config: &Config) -> (f64, f64) {
        let found = &shoot(gpu, &self.stage, &self.light, config)[..self.along.len()];
        let square = |(a, b): (&f32, &f32)| f64::from(a - b).powi(2);
        let sum: f64 = found.iter().zip(&self.truth).map(square).sum();
        let width = |v: &[f32]| penumbra_width(&self.along, v).expect("a penumbra");
        ((sum / self.along.len() as f64).sqrt(), width(found) / width(&self.truth) - 1.0)
    }
}

/// Sheets that are endless in z, of x in the given ranges at the given depths below a square light of half size 1, and the
/// point (x, 0) on a floor at the depth 10.
pub(crate) fn below_a_square_light(
    gpu: &Gpu,
    sheets: &[(f64, f64, f64)],
    x: f64,
    config: &Config,
) -> f32 {
    along_a_floor(gpu, sheets, &[x], config)[0]
}

/// As [`below_a_square_light`], for several points at once.
pub(crate) fn along_a_floor(
    gpu: &Gpu,
    sheets: &[(f64, f64, f64)],
    places: &[f64],
    config: &Config,
) -> Vec<f32> {
    let mut scene = Scene { name: "sheets".to_owned(), ..Scene::default() };
    let floor = generate::shapes::quad(DVec3::Y * -10.0, DVec3::Z * 60.0, DVec3::X * 60.0);
    scene.add(floor, DAffine3::IDENTITY);
    for (from, to, depth) in sheets {
        let center = DVec3::new(0.5 * (from + to), -depth, 0.0);
        let half = DVec3::X * 0.5 * (to - from);
        scene.add(generate::shapes::quad(center, DVec3::Z * 50.0, half), DAffine3::IDENTITY);
    }
    let position = |x: &f64| (DVec3::new(*x, -10.0, 0.0) - scene.origin()).as_vec3();
    let samples: Vec<ViewSample> =
        places.iter().map(|x| ViewSample { position: position(x), normal: Vec3::Y }).collect();
    let stage = Stage::at_points(gpu, &scene, &samples).expect("a stage");
    let light = Light::Rect { center: DVec3::ZERO, half_u: DVec3::X, half_v: DVec3::Z };
    let mut found = shoot(gpu, &stage, &light, config);
    found.truncate(places.len());
    found
}
