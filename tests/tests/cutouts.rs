//! Casters with holes: what is drawn of them, and what they shadow.

use std::sync::Arc;

use antumbra_gpu::{
    Counters, Frame, Gpu, GpuError, MeshSet, Recorder, Technique, read_f32_texture,
};
use antumbra_map::{MapConfig, MapTechnique};
use antumbra_measure::Stage;
use antumbra_reference::closed::{Occluder, is_tie, visibility};
use antumbra_scene::generate::{self, LeafCard, shapes};
use antumbra_scene::{AlphaMap, Camera, Cutout, Light, Scene, Wrap};
use antumbra_tests::gpu;
use glam::{DAffine3, DVec2, DVec3, Vec2, Vec3};

fn run(gpu: &Gpu, stage: &Stage, light: &Light, size: u32) -> (Vec<f32>, Counters) {
    let config = MapConfig { size, ..MapConfig::default() };
    let mut technique = MapTechnique::plain(gpu, &config).expect("a valid config");
    let frame: Frame<'_> = stage.frame(light);
    let target = frame.samples.visibility_target(gpu).expect("a target");
    technique.prepare(gpu, &frame).expect("prepared");
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    technique
        .encode(
            gpu,
            &frame,
            &mut Recorder::new(&mut encoder),
            &target.create_view(&Default::default()),
        )
        .expect("encoded");
    gpu.queue.submit([encoder.finish()]);
    (read_f32_texture(gpu, &target, 0).expect("read back"), technique.counters())
}

/// The tree with all alpha of its leaves at `alpha`.
fn tree(alpha: Option<u8>) -> Scene {
    let mut scene = generate::by_name("tree").expect("a generated scene");
    let leaves = scene.meshes.iter().position(|m| m.name == "leaves").expect("a tree has leaves");
    if let Some(alpha) = alpha {
        let uv = vec![Vec2::splat(0.3); scene.meshes[leaves].positions.len()];
        let alpha =
            Arc::new(AlphaMap { width: 1, height: 1, texels: vec![alpha], ..AlphaMap::default() });
        scene.cutouts.insert(leaves, Arc::new(Cutout { uv, alpha, cutoff: 127.5 }));
    }
    scene
}

#[test]
fn leaves_without_holes_are_drawn_bit_for_bit_as_whole_ones() {
    let gpu = gpu();
    let [whole, full, gone] = [None, Some(255), Some(0)].map(|alpha| {
        let scene = tree(alpha);
        let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 128, 128).expect("a stage");
        let seen: Vec<_> = scene.lights.iter().map(|light| run(&gpu, &stage, light, 512)).collect();
        (stage.image.positions, stage.image.normals, seen)
    });
    assert!(full.0 == whole.0 && full.1 == whole.1, "the same view samples");
    for (full, whole) in full.2.iter().zip(&whole.2) {
        assert!(full.0 == whole.0, "the same visibility");
        assert_eq!(full.1["map_triangles"], whole.1["map_triangles"], "the same triangles");
    }
    // The control: of leaves that are not there, nothing is seen.
    assert!(gone.0 != whole.0, "leaves without alpha are seen");
}

#[test]
fn a_leaf_on_a_card_shadows_what_its_disc_shadows() {
    let gpu = gpu();
    let numbers = LeafCard::default();
    let scene = generate::leaf_card(&numbers);
    let mut whole = scene.clone();
    whole.cutouts.clear();
    let camera = scene.camera.expect("a camera");
    let radius = numbers.radius * numbers.half;
    let disc = Occluder::Disc { center: numbers.height * DVec3::Y, normal: DVec3::Y, radius };
    const MAP: u32 = 512;
    let [cut, control] =
        [&scene, &whole].map(|s| Stage::new(&gpu, s, camera, 128, 128).expect("a stage"));
    let on_card = |stage: &Stage| -> Vec<f64> {
        let card = stage.image.positions.iter().filter(|p| p.y > 1.0);
        card.map(|p| f64::from(p.x).hypot(f64::from(p.z))).collect()
    };
    let (leaf, card) = (on_card(&cut), on_card(&control));
    assert!(leaf.len() > 100, "{} samples of the leaf", leaf.len());
    // Texture coordinates are interpolated to some 1e-6.
    let farthest = leaf.iter().copied().fold(0.0, f64::max);
    assert!(farthest < radius + numbers.accuracy() + 1e-5, "the leaf is seen {farthest} m out");
    assert!(card.iter().any(|d| *d > 1.1 * radius), "the whole card has corners");
    for light in &scene.lights {
        let wrong = |stage: &Stage| {
            let (seen, _) = run(&gpu, stage, light, MAP);
            // A texel of the map, on a card of 2 m with its guard band, and its shadow up to 1.5 times as large; across
            // its diagonal.
            let texel = 2.0 / f64::from(MAP - 8) * 1.5 * std::f64::consts::SQRT_2;
            let samples = stage.image.positions.iter().zip(&stage.image.normals).zip(seen);
            let wrong = samples.filter(|((p, n), v)| {
                let at = p.as_dvec3();
                **n != Vec3::ZERO
                    && p.y < 1.0
                    && !is_tie(&disc, light, at, texel + numbers.accuracy())
                    && f64::from(*v) != visibility(&disc, light, at)
            });
            wrong.count()
        };
        assert_eq!(wrong(&cut), 0, "{light:?}");
        assert!(wrong(&control) > 20, "{light:?}: a whole card passes for a leaf");
    }
}

/// Every way to wrap and to filter, on a card seen from above, against the twin.
#[test]
fn what_is_seen_of_a_card_is_what_its_alpha_says() {
    let gpu = gpu();
    let texels: Vec<u8> = (0..35_u32).map(|i| (i * 151 % 256) as u8).collect();
    for wrap in [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror] {
        for nearest in [false, true] {
            let alpha = AlphaMap {
                width: 7,
                height: 5,
                texels: texels.clone(),
                wrap: [wrap, Wrap::Repeat],
                nearest,
            };
            let mut scene = Scene::default();
            scene.add(shapes::floor(5.0), DAffine3::IDENTITY);
            scene.add(shapes::quad(DVec3::Y, DVec3::Z, DVec3::X), DAffine3::IDENTITY);
            // From -1.25 to 1.75 along both.
            let uv = [(0, 0), (1, 0), (1, 1), (0, 1)];
            let uv = uv.map(|(u, v)| Vec2::new(3.0 * u as f32, 3.0 * v as f32) - 1.25);
            let cutout = Cutout { uv: uv.to_vec(), alpha: Arc::new(alpha), cutoff: 120.0 };
            scene.cutouts.insert(1, Arc::new(cutout.clone()));
            let eye = 3.0 * DVec3::Y;
            let camera = Camera { eye, target: DVec3::ZERO, up: DVec3::Z, fov_y: 0.9, near: 0.1 };
            let stage = Stage::new(&gpu, &scene, camera, 128, 128).expect("a stage");
            let (mut there, mut holes) = (0, 0);
            for p in &stage.image.positions {
                // Where the line of sight meets the card: u along z, v along x.
                let p = p.as_dvec3();
                let at = eye + (p - eye) * (2.0 / (3.0 - p.y));
                let uv = (DVec2::new(at.z, at.x) + 1.0) * 1.5 - 1.25;
                if at.x.abs().max(at.z.abs()) > 0.99 {
                    continue;
                }
                let alpha = cutout.alpha.at(uv.as_vec2());
                let step = |d: DVec2| cutout.alpha.at((uv + d * 1e-4).as_vec2());
                let near = [DVec2::X, DVec2::Y, -DVec2::X, -DVec2::Y].map(step);
                let is_there = |alpha: f32| alpha >= cutout.cutoff;
                if near.iter().any(|a| is_there(*a) != is_there(alpha)) {
                    continue;
                }
                let seen = p.y > 0.5;
                assert_eq!(
                    seen,
                    is_there(alpha),
                    "{wrap:?}, nearest {nearest}: alpha {alpha} at {uv}"
                );
                *if seen { &mut there } else { &mut holes } += 1;
            }
            assert!(there > 1000 && holes > 1000, "{there} samples on the card, {holes} in holes");
        }
    }
}

#[test]
fn a_cut_out_without_its_data_is_refused() {
    let gpu = gpu();
    let scene = tree(Some(255));
    let mut triangles = scene.triangles(scene.origin()).expect("a valid scene");
    assert!(MeshSet::from_triangles(&gpu, &triangles).is_ok(), "a sound one");
    triangles.cuts[0].first_vertex += 1;
    let fault = MeshSet::from_triangles(&gpu, &triangles).expect_err("a fault");
    assert!(matches!(fault, GpuError::Invalid { what: "cut-out", .. }), "{fault}");
}
