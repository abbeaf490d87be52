//! What is drawn into a map by what is looked up of it: less, and not a bit of visibility changes.

use std::ops::Range;

use antumbra_filter::{PcfCastano, PcfHardware, PcfPoisson, Vsm};
use antumbra_gpu::{
    CasterBody, CasterClusters, CasterTriangles, Casters, Counters, Drawn, Frame, Gpu, GpuError,
    LightView, ListedTriangles, MeshSet, Recorder, Technique, TechniqueConfig, read_f32_texture,
    wgpu,
};
use antumbra_map::{MapConfig, Omni, Plain};
use antumbra_measure::Stage;
use antumbra_sampling::{Cascades, Sdsm, Select};
use antumbra_scene::generate::shapes;
use antumbra_scene::{Camera, Light, LightKind, Scene, generate};
use antumbra_tests::gpu;
use glam::{DAffine3, DVec3};

/// Techniques over a map of `size` texels, with kernels from one texel to seven a side.
fn techniques(gpu: &Gpu, size: u32, receiver_mask: bool) -> Vec<Box<dyn Technique>> {
    let map = MapConfig { size, receiver_mask, ..MapConfig::default() };
    let tetrahedron = MapConfig { omni: Omni::Tetrahedron, ..map };
    let cascades = Cascades { of: Plain { map }, ..Cascades::default() };
    let by_depth = Cascades { select: Select::Depth, ..cascades };
    let configs: [&dyn TechniqueConfig; 9] = [
        &Plain { map },
        &Plain { map: tetrahedron },
        &PcfHardware { map, comparison: false },
        &PcfHardware { map, comparison: true },
        &PcfCastano { map, side: 7, ..Default::default() },
        &PcfPoisson { map, radius: 3.5, ..Default::default() },
        &cascades,
        &by_depth,
        &Sdsm {
            of: PcfCastano { map, ..Default::default() },
            cull: receiver_mask,
            ..Sdsm::default()
        },
    ];
    configs.map(|config| config.build(gpu).expect("a valid config")).into()
}

fn run(gpu: &Gpu, frame: &Frame<'_>, technique: &mut dyn Technique) -> (Vec<f32>, Counters) {
    let target = frame.samples.visibility_target(gpu).expect("a target");
    let view = target.create_view(&Default::default());
    technique.prepare(gpu, frame).expect("prepared");
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    technique.encode(gpu, frame, &mut Recorder::new(&mut encoder), &view).expect("encoded");
    gpu.queue.submit([encoder.finish()]);
    let seen = read_f32_texture(gpu, &target, 0).expect("read back");
    gpu.check().expect("no error of wgpu's");
    (seen, technique.read_counters(gpu).expect("counted"))
}

fn look(eye: [f64; 3], target: [f64; 3]) -> Camera {
    let fov_y = std::f64::consts::FRAC_PI_3;
    Camera { eye: eye.into(), target: target.into(), up: DVec3::Y, fov_y, near: 0.05 }
}

/// Runs all techniques with and without a mask; gives the triangles of each pair.
fn compare(gpu: &Gpu, stage: &Stage, light: &Light, size: u32, what: &str) -> Vec<(u64, u64)> {
    let frame = stage.frame(light);
    let pairs = techniques(gpu, size, true).into_iter().zip(techniques(gpu, size, false));
    let pairs = pairs.enumerate().map(|(number, (mut masked, mut whole))| {
        let (seen, work) = run(gpu, &frame, masked.as_mut());
        let (all, all_work) = run(gpu, &frame, whole.as_mut());
        let changed = seen.iter().zip(&all).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
        assert_eq!(changed, 0, "{what}, technique {number}, {light:?}: the mask is seen");
        let (few, most) = (work["map_triangles"], all_work["map_triangles"]);
        assert!(few <= most, "{what}, technique {number}, {light:?}: {few} of {most} triangles");
        (few, most)
    });
    pairs.collect()
}

#[test]
fn from_the_street_less_than_a_third_is_drawn_of_what_is_there() {
    let gpu = gpu();
    let scene = generate::street();
    let all = scene.triangle_count() as u64;
    let lamp = DVec3::new(4.0, 6.5, 17.0);
    let lights = [
        scene.lights[0],
        Light::Spot { position: lamp, direction: DVec3::new(-0.5, -1.0, 0.0), outer_angle: 0.8 },
        Light::Point { position: lamp },
    ];
    // Across the street, over the shoulder, and along all of it, where every front is in view.
    let views = [
        look([2.0, 1.7, 20.0], [-7.0, 2.5, 14.0]),
        look([5.0, 1.7, 100.0], [-7.0, 1.0, 104.0]),
        look([1.0, 1.7, 190.0], [0.0, 1.5, 100.0]),
    ];
    for (number, camera) in views.into_iter().enumerate() {
        let stage = Stage::new(&gpu, &scene, camera, 128, 96).expect("a stage");
        for (kind, light) in lights.iter().enumerate() {
            for (few, most) in compare(&gpu, &stage, light, 512, "street") {
                let along = number == 2;
                if kind == 0 {
                    let enough = if along { few < most } else { 3 * few <= all };
                    assert!(enough, "view {number}: {few} of {all} triangles, unmasked {most}");
                }
            }
        }
    }
}

#[test]
fn no_scene_shows_its_mask() {
    let gpu = gpu();
    let names = ["hall", "tree", "grass", "leaf-card", "sphere"];
    for (first, name) in names.into_iter().enumerate() {
        let scene = generate::by_name(name).expect("a generated scene");
        let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 96, 96).expect("a stage");
        let kinds = [LightKind::Directional, LightKind::Spot, LightKind::Point];
        for (turn, kind) in kinds.into_iter().enumerate() {
            // Cells of one texel and of two.
            let size = [200, 512][(first + turn) % 2];
            compare(&gpu, &stage, &scene.place_light(kind), size, name);
        }
    }
}

/// HC-27, poles in the shadow of a wall, and HC-28, cubes below the floor: some of what is there is not drawn.
#[test]
fn behind_a_wall_and_below_a_floor_less_is_drawn() {
    let gpu = gpu();
    for (scene, size) in [(generate::poles(30, true), 512), (generate::two_storeys(true), 512)] {
        let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 96, 96).expect("a stage");
        let light = scene.lights[0];
        let pairs = compare(&gpu, &stage, &light, size, &scene.name);
        // Maps of one view, which draws each triangle once.
        for (few, _) in &pairs[..6] {
            assert!(*few < scene.triangle_count() as u64, "{}: all {few} triangles", scene.name);
        }
    }
}

/// Boxes behind a wall, as the camera sees them, under a sun overhead: they shadow only what the wall hides.
fn behind_a_wall() -> (Scene, Camera) {
    let mut scene = Scene::default();
    scene.add(shapes::floor(40.0), DAffine3::IDENTITY);
    let wall = shapes::cuboid(DVec3::new(-30.0, 0.0, -5.5), DVec3::new(30.0, 20.0, -5.0));
    scene.add(wall, DAffine3::IDENTITY);
    for i in 0..100 {
        let center =
            DVec3::new(f64::from(i % 20) * 2.0 - 19.0, 1.0, -8.0 - 3.0 * f64::from(i / 20));
        scene.add(shapes::cuboid(center - 0.5, center + 0.5), DAffine3::IDENTITY);
    }
    let seen = shapes::cuboid(DVec3::new(-1.0, 1.0, -2.0), DVec3::new(1.0, 2.0, -1.0));
    scene.add(seen, DAffine3::IDENTITY);
    (scene, look([0.0, 1.7, 5.0], [0.0, 1.0, -5.0]))
}

const OVERHEAD: Light = Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 };

#[test]
fn what_is_hidden_from_the_camera_with_all_its_shadow_is_not_drawn() {
    let gpu = gpu();
    let (scene, camera) = behind_a_wall();
    let stage = Stage::new(&gpu, &scene, camera, 96, 96).expect("a stage");
    for (few, most) in compare(&gpu, &stage, &OVERHEAD, 1024, "behind a wall") {
        // The box before the wall, and the wall where a sample lies at its foot.
        assert!((12..=24).contains(&few), "{few} triangles");
        assert!(most > 300, "without a mask, boxes in the frustum are drawn: {most}");
    }
    // From the other side of the wall they are seen and drawn.
    let above = look([0.0, 50.0, -40.0], [0.0, 0.0, -14.0]);
    let stage = Stage::new(&gpu, &scene, above, 96, 96).expect("a stage");
    for (few, _) in compare(&gpu, &stage, &OVERHEAD, 1024, "beyond a wall") {
        assert!(few > 800, "{few} triangles");
    }
}

/// A mesh set with the boxes of another.
struct Astray<'a> {
    meshes: &'a MeshSet,
    boxes: &'a MeshSet,
}

impl Casters for Astray<'_> {
    fn hull(&self, light: &Light, visit: &mut dyn FnMut(DVec3)) {
        self.meshes.hull(light, visit);
    }
    fn bodies(&self, visit: &mut dyn FnMut(&CasterBody<'_>)) -> bool {
        self.meshes.bodies(visit)
    }
    fn draw(&self, view: &LightView<'_>, pass: &mut wgpu::RenderPass<'_>) -> Drawn {
        self.meshes.draw(view, pass)
    }
    fn triangles(&self) -> Option<CasterTriangles<'_>> {
        self.meshes.triangles()
    }
    fn clusters(&self, gpu: &Gpu) -> Option<CasterClusters<'_>> {
        self.boxes.clusters(gpu)
    }
    fn kept_clusters(&self, view: &LightView<'_>, visit: &mut dyn FnMut(Range<u32>)) {
        self.meshes.kept_clusters(view, visit);
    }
    fn draw_listed(
        &self,
        view: &LightView<'_>,
        list: &ListedTriangles<'_>,
        pass: &mut wgpu::RenderPass<'_>,
    ) -> u64 {
        self.meshes.draw_listed(view, list, pass)
    }
}

/// The control of the tests above: casters whose boxes are elsewhere are missed.
#[test]
fn a_mask_over_the_wrong_boxes_is_seen() {
    let gpu = gpu();
    let (scene, camera) = behind_a_wall();
    let stage = Stage::new(&gpu, &scene, camera, 96, 96).expect("a stage");
    let mut moved = scene.clone();
    for instance in &mut moved.instances {
        instance.transform.translation.z -= 15.0;
    }
    let moved = MeshSet::new(&gpu, &moved).expect("a valid scene");
    let run = |casters: &dyn Casters| {
        let frame = Frame { casters, ..stage.frame(&OVERHEAD) };
        run(&gpu, &frame, techniques(&gpu, 512, true)[0].as_mut()).0
    };
    let right = run(&Astray { meshes: &stage.meshes, boxes: &stage.meshes });
    let wrong = run(&Astray { meshes: &stage.meshes, boxes: &moved });
    assert!(right == run(&stage.meshes), "a wrapper is no matter");
    assert!(right != wrong, "shadows do not depend on what the mask keeps");
}

#[test]
fn a_store_made_of_the_whole_map_takes_no_mask() {
    let map = MapConfig { receiver_mask: true, ..MapConfig::default() };
    let refused = Vsm { map, ..Default::default() }.build(&gpu());
    let fault = refused.err().expect("an error");
    assert!(matches!(fault, GpuError::Invalid { what: "receiver mask", .. }), "{fault}");
}

#[test]
fn casters_without_clusters_are_drawn_as_without_a_mask() {
    struct Plainly<'a>(&'a MeshSet);
    impl Casters for Plainly<'_> {
        fn hull(&self, light: &Light, visit: &mut dyn FnMut(DVec3)) {
            self.0.hull(light, visit);
        }
        fn draw(&self, view: &LightView<'_>, pass: &mut wgpu::RenderPass<'_>) -> Drawn {
            self.0.draw(view, pass)
        }
    }
    let gpu = gpu();
    let (scene, camera) = behind_a_wall();
    let stage = Stage::new(&gpu, &scene, camera, 64, 64).expect("a stage");
    let frame = Frame { casters: &Plainly(&stage.meshes), ..stage.frame(&OVERHEAD) };
    let (masked, work) = run(&gpu, &frame, techniques(&gpu, 512, true)[0].as_mut());
    let (whole, all_work) = run(&gpu, &frame, techniques(&gpu, 512, false)[0].as_mut());
    assert!(masked == whole, "the same visibility");
    assert_eq!(work, all_work, "the same work");
}
