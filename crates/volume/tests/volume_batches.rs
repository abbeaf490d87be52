//! Asking only batches of triangles that a ray may meet gives the bits of asking all.

use antumbra_gpu::{Gpu, GpuOptions, TechniqueConfig};
use antumbra_measure::{Shot, Stage};
use antumbra_reference::ViewSample;
use antumbra_scene::generate;
use antumbra_scene::{Light, LightKind, Mesh, Scene};
use antumbra_volume::{Triangle, homogeneous_light, twin};
use glam::{DAffine3, DVec3, DVec4};

fn gpu() -> Gpu {
    Gpu::new(&GpuOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

/// SplitMix64 (Steele, Lea, Flood 2014).
struct Random(u64);

impl Random {
    /// A number in [0, 1).
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 * 0.5_f64.powi(53)
    }

    fn point(&mut self) -> DVec3 {
        2.0 * DVec3::new(self.unit(), self.unit(), self.unit()) - 1.0
    }

    /// 10 to the power of a number between `low` and `high`.
    fn decade(&mut self, low: f64, high: f64) -> f64 {
        10.0_f64.powf(low + (high - low) * self.unit())
    }
}

const TRIANGLES: usize = 1024;

/// Clusters in a row, each a batch: ordinary triangles, or bundles of needles or of such as the light sees nearly edge-on, about one
/// edge, so that the box is no larger than they are.
fn soup(light: DVec4, random: &mut Random) -> Vec<[DVec3; 3]> {
    let mut soup = Vec::new();
    for cluster in 0..TRIANGLES / 64 {
        let center = DVec3::new(cluster as f64 - 8.0, 0.0, 0.0) + 0.3 * random.point();
        let size = random.decade(-2.0, -0.7);
        let edge = size * random.point();
        for _ in 0..64 {
            let spread = if cluster % 3 == 0 { size } else { 1e-3 * size };
            let a = center + spread * random.point();
            let b = a + edge + spread * random.point();
            let beside = random.decade(-7.0, -3.0) * size * random.point();
            let c = match cluster % 3 {
                0 => a + size * random.point(),
                1 => a + random.unit() * (b - a) + beside,
                _ => a + size * (light.truncate() - light.w * a).normalize() + beside,
            };
            soup.push([a, b, c].map(|v| v.as_vec3().as_dvec3()));
        }
    }
    soup
}

/// Tiles of samples on the planes of the soup's sides, where rounding decides of every sign: behind an edge or beyond its
/// ends, near and far.
fn on_sides(light: DVec4, soup: &[[DVec3; 3]], random: &mut Random) -> Vec<ViewSample> {
    let towards = |p: DVec3| light.truncate() - light.w * p;
    let mut tiles = Vec::new();
    for _ in 0..512 {
        let triangle = soup[(random.unit() * TRIANGLES as f64) as usize];
        let (a, b) = (triangle[0], triangle[1 + (random.unit() * 2.0) as usize]);
        let on = a + (3.0 * random.unit() - 1.0) * (b - a);
        let far =
            random.decade(-2.0, 1.0) / if light.w == 0.0 { 1.0 } else { towards(on).length() };
        let tile: Vec<ViewSample> = (0..64)
            .map(|i| {
                let p = on - towards(on) * (far * (1.0 + 1e-3 * f64::from(i)));
                let normal = towards(p).normalize().as_vec3();
                ViewSample { position: p.as_vec3(), normal }
            })
            .collect();
        tiles.push(tile);
    }
    // Rows of 256 samples, 32 tiles of 8 x 8.
    (0..512 * 64)
        .map(|i| {
            let (x, y) = (i % 256, i / 256);
            tiles[y / 8 * 32 + x / 8][y % 8 * 8 + x % 8]
        })
        .collect()
}

fn ask(gpu: &Gpu, stage: &Stage, light: &Light, culling: bool) -> Shot {
    let mut technique = Triangle { culling }.build(gpu).expect("a valid config");
    stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot")
}

#[test]
fn what_rounding_makes_of_triangles_is_asked_for_too() {
    let gpu = gpu();
    let mut random = Random(11);
    let position = DVec3::new(1.3, 6.0, -0.7);
    for light in [
        Light::Directional { direction: DVec3::new(0.3, -0.9, 0.2), angular_diameter: 0.0 },
        Light::Point { position },
        Light::Point { position: DVec3::new(0.4, 0.3, 0.2) },
    ] {
        let at = match light.position() {
            Some(position) => position.extend(1.0),
            None => light.towards(DVec3::ZERO, glam::DVec2::splat(0.5)).extend(0.0),
        };
        let soup = soup(at, &mut random);
        let mut mesh = Mesh::default();
        for (i, triangle) in (0..).zip(&soup) {
            mesh.positions.extend(triangle.map(|v| v.as_vec3()));
            mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        }
        let mut scene = Scene::default();
        scene.add(mesh, DAffine3::IDENTITY);
        let origin = scene.origin();
        let mut samples = on_sides(at, &soup, &mut random);
        for sample in &mut samples {
            sample.position = (sample.position.as_dvec3() - origin).as_vec3();
        }
        let stage = Stage::at_points(&gpu, &scene, &samples).expect("a stage");
        let [all, left] = [false, true].map(|culling| ask(&gpu, &stage, &light, culling));
        let other = (0..samples.len()).filter(|i| all.visibility[*i] != left.visibility[*i]);
        assert_eq!(other.count(), 0, "{light:?}: samples are other than if all are asked");
        let asked = |shot: &Shot| shot.counters["asked_batches"];
        assert!(asked(&left) * 4 < asked(&all) * 3, "{} of {}", asked(&left), asked(&all));
        // Rounding does decide: some are dark that exactly are not, and the other way round.
        let at = homogeneous_light(&stage.frame(&light)).as_dvec4();
        let corner = |i: u32| stage.triangles.positions[i as usize].as_dvec3();
        let volumes: Vec<twin::Volume> = stage
            .triangles
            .triangles
            .iter()
            .filter_map(|t| twin::Volume::new(at, t.map(corner)))
            .collect();
        let mut decided = [0; 2];
        for i in (0..samples.len()).step_by(61) {
            let p = samples[i].position.as_dvec3();
            let dark = volumes.iter().any(|volume| volume.contains(p));
            if dark != (all.visibility[i] == 0.0) {
                decided[usize::from(dark)] += 1;
            }
        }
        assert!(decided[0] > 0, "{light:?}: rounding decides of none: {decided:?}");
    }
}

#[test]
fn scenes_look_the_same_and_cost_less() {
    let gpu = gpu();
    for name in ["sphere", "tree", "street"] {
        let scene = generate::by_name(name).expect("a scene");
        let camera = scene.camera_or_framing();
        let stage = Stage::new(&gpu, &scene, camera, 64, 64).expect("a stage");
        for kind in [LightKind::Directional, LightKind::Point] {
            let light = scene.light_or_placed(kind);
            let [all, left] = [false, true].map(|culling| ask(&gpu, &stage, &light, culling));
            assert!(all.visibility == left.visibility, "{name}, {kind:?}: other bits");
            let asked = |shot: &Shot| shot.counters["asked_batches"];
            assert!(
                asked(&left) * 2 < asked(&all),
                "{name}, {kind:?}: {} of {}",
                asked(&left),
                asked(&all)
            );
        }
    }
}

#[test]
fn compute_passes_take_the_time_that_they_take() {
    let gpu = gpu();
    let scene = generate::by_name("sphere").expect("a scene");
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 64, 64).expect("a stage");
    let light = scene.light_or_placed(LightKind::Point);
    let mut technique = Triangle { culling: false }.build(&gpu).expect("a valid config");
    let mut session = stage.session(&gpu).expect("a session");
    let mut shot = Shot::default();
    session.repeat(&gpu, &light, technique.as_mut(), &mut shot, false).expect("a shot");
    let begin = std::time::Instant::now();
    for _ in 0..5 {
        session.repeat(&gpu, &light, technique.as_mut(), &mut shot, true).expect("a shot");
    }
    // All else that a repetition does is small beside asking thousands of triangles for thousands of samples.
    let wall_ms = begin.elapsed().as_secs_f64() * 1e3;
    let gpu_ms: f64 = shot.gpu_ms.iter().sum();
    assert!(gpu_ms < wall_ms && gpu_ms > 0.2 * wall_ms, "{gpu_ms} ms of {wall_ms}");
}
