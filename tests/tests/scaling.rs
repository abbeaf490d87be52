//! How error and work grow with the parameters, where theory says how.

use antumbra::Config;
use antumbra_filter::PcfGrid;
use antumbra_gpu::{Gpu, TechniqueConfig};
use antumbra_map::{MapConfig, MapTechnique};
use antumbra_measure::Stage;
use antumbra_reference::ViewSample;
use antumbra_reference::closed::{Occluder, visibility};
use antumbra_scene::generate::{self, HalfPlaneOverPlane, half_plane_over_plane, shapes};
use antumbra_scene::{Light, LightKind, Scene};
use antumbra_tests::gpu;
use antumbra_volume::{Silhouette, ZFail};
use glam::{DAffine3, DVec2, DVec3, Vec3};

/// Depth of the half-plane, metres: the map's window is fitted to it.
const EXTENT: f64 = 10.0;
/// Samples a side.
const SIDE: usize = 256;

fn scene() -> Scene {
    half_plane_over_plane(&HalfPlaneOverPlane { extent: EXTENT, ..HalfPlaneOverPlane::default() })
}

/// Floor samples within 10 cm of the edge's shadow.
fn around_the_edge(light: &Light) -> Vec<ViewSample> {
    let edge = 2.0 * DVec3::Y;
    let away = -light.towards(edge, DVec2::splat(0.5));
    let foot = edge - away * (edge.y / away.y);
    let cell = |i: usize| (i as f64 + 0.5) / SIDE as f64 - 0.5;
    (0..SIDE * SIDE)
        .map(|i| {
            let p = foot + DVec3::new(0.2 * cell(i % SIDE), 0.0, 8.0 * cell(i / SIDE));
            ViewSample { position: p.as_vec3(), normal: Vec3::Y }
        })
        .collect()
}

/// Mean absolute error of the plain map of `size` texels.
fn error(gpu: &Gpu, light: &Light, size: u32) -> f64 {
    let points = around_the_edge(light);
    let stage = Stage::at_points(gpu, &scene(), &points).expect("a stage");
    let map = MapConfig { size, ..MapConfig::default() };
    let mut technique = MapTechnique::plain(gpu, &map).expect("a valid config");
    let shot = stage.shoot(gpu, light, &mut technique, 0).expect("a shot");
    let sheet =
        Occluder::HalfPlane { point: 2.0 * DVec3::Y, normal: DVec3::Y, inward: DVec3::NEG_X };
    let wrong = points.iter().zip(&shot.visibility).map(|(point, v)| {
        (f64::from(*v) - visibility(&sheet, light, point.position.as_dvec3())).abs()
    });
    wrong.sum::<f64>() / points.len() as f64
}

/// Where an edge cuts a texel, the map gives the whole texel the side on which its centre lies, so what is
/// wrong is the strip between the true edge and that staircase. The strip's mean width is a fixed share of
/// a texel once the edge crosses the rows at all phases, as it does under suns that stand askew; texels
/// halve with twice the side. So does the error.
#[test]
fn twice_the_side_of_the_map_halves_the_error() {
    let gpu = gpu();
    let suns = [20.0, 35.0, 50.0, 65.0_f64]
        .map(|azimuth| Light::sun(50_f64.to_radians(), azimuth.to_radians(), 0.0));
    let mean =
        |size| suns.iter().map(|sun| error(&gpu, sun, size)).sum::<f64>() / suns.len() as f64;
    let errors = [512, 1024, 2048].map(mean);
    for pair in errors.windows(2) {
        let ratio = pair[0] / pair[1];
        assert!((1.6..=2.4).contains(&ratio), "errors {errors:?}: a factor of {ratio}, not 2");
    }
}

#[test]
fn fetches_grow_with_the_square_of_the_kernel() {
    let gpu = gpu();
    let light = Light::sun(50_f64.to_radians(), 0.6, 0.0);
    let stage = Stage::at_points(&gpu, &scene(), &around_the_edge(&light)).expect("a stage");
    let map = MapConfig { size: 256, ..MapConfig::default() };
    for side in [1, 2, 3, 5, 7, 15] {
        let mut technique = PcfGrid { map, side }.build(&gpu).expect("a valid config");
        let counters = stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot").counters;
        let expected = (SIDE * SIDE) as u64 * u64::from(side).pow(2);
        assert_eq!(counters["fetches"], expected, "a kernel of {side} x {side}");
    }
}

/// Dividing a sphere's triangles in four doubles its silhouette: a closed line of edges once around it, that goes to and fro by
/// at most twice its length. All of the volumes' sides are four times as many.
#[test]
fn silhouettes_grow_as_the_square_root_of_triangles() {
    let gpu = gpu();
    let [mut sides, mut all_sides] = [[0; 2]; 2];
    for (i, divisions) in [2, 5].into_iter().enumerate() {
        let mut scene = Scene::default();
        scene.add(shapes::floor(5.0), DAffine3::IDENTITY);
        let up = DAffine3::from_translation(1.3 * DVec3::Y);
        scene.add(shapes::icosphere(divisions, 1.0), up);
        let stage = Stage::new(&gpu, &scene, scene.framing_camera(), 32, 32).expect("a stage");
        let light = scene.place_light(LightKind::Point);
        let count = |config: &dyn TechniqueConfig| {
            let mut technique = config.build(&gpu).expect("a valid config");
            let shot = stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot");
            shot.counters["volume_sides"]
        };
        sides[i] = count(&Silhouette::default());
        all_sides[i] = count(&ZFail::default());
    }
    let [sides, all_sides] = [sides, all_sides].map(|[few, many]| many as f64 / few as f64);
    assert!(
        (4.0..16.0).contains(&sides),
        "{sides} times the silhouette for 64 times the triangles"
    );
    assert!(all_sides > 60.0, "{all_sides} times the sides");
}

/// What puts a map's samples elsewhere, on a street that is seen along its length: work goes with the square of the
/// side and no more than as many maps, and what has no map does not know its side.
#[test]
fn work_of_what_places_samples_grows_with_the_square_of_the_side() {
    let gpu = gpu();
    let scene = generate::street();
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 128, 72).expect("a stage");
    let light = scene.lights[0];
    let run = |id: &str, size: u32| {
        let mut config: Config =
            serde_json::from_str(&format!(r#"{{ "technique": "{id}" }}"#)).expect("known");
        config.set_map_size(size);
        let mut technique = config.build(&gpu).expect("a valid config");
        stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot").counters
    };
    for (id, maps) in
        [("map/plain", 1), ("sampling/lispsm", 1), ("sampling/cascades", 4), ("sampling/sdsm", 4)]
    {
        let mut triangles = None;
        for size in [128, 256, 512] {
            let work = run(id, size);
            assert_eq!(work["map_passes"], maps, "{id}");
            assert_eq!(work["map_texels"], maps * u64::from(size).pow(2), "{id} of {size}");
            // Windows go by steps of their texels, which is a cluster more or less.
            let drawn = work["map_triangles"] as f64;
            let most = *triangles.get_or_insert(drawn) * 1.1;
            assert!(drawn <= most, "{id} of {size}: {drawn} triangles");
        }
    }
    // Pages: those that are looked up, never more than the whole map has, and each drawn once.
    for size in [1024, 2048] {
        let work = run("sampling/matched", size);
        assert!(work["pages_in_use"] > 0, "{work:?}");
        assert_eq!(work["map_passes"], 1, "{work:?}");
    }
    // No map at all.
    let [few, many] = [128, 1024].map(|size| run("sampling/view-samples", size));
    assert_eq!(few, many, "work goes with view samples and triangles");
}
