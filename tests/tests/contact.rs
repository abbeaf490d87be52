//! Shadows begin where caster and receiver touch: the gap at a thin wall (HC-04) and a cube (HC-05).

use antumbra_filter::{PcfBilinearGrid, PcfCastano, PcfGrid, PcfHardware, PcfPoisson};
use antumbra_gpu::{Frame, Gpu, MeshSet, Recorder, Technique as _, ViewSamples, read_f32_texture};
use antumbra_map::{Bias, Estimator, MapConfig, MapTechnique, twin};
use antumbra_reference::contact_gap;
use antumbra_scene::{Scene, generate};
use antumbra_tests::gpu;
use glam::{DVec3, Vec3};

/// Floor samples from the foot of the caster into its shadow, and the shadow's foot and length (z).
const SAMPLES: u32 = 4096;

/// The contact gap in map texels, for an estimator on a map of `size` texels.
fn gap(gpu: &Gpu, scene: &Scene, foot: f64, estimator: Estimator, map: MapConfig) -> f64 {
    let light = scene.lights[0];
    let meshes = MeshSet::new(gpu, scene).expect("a valid scene");
    let samples = ViewSamples::new(gpu, SAMPLES, 1).expect("a valid size");
    // One metre of floor, half way along the caster, where the shadow is at least a metre long.
    let distances: Vec<f64> =
        (0..SAMPLES).map(|i| (f64::from(i) + 0.5) / f64::from(SAMPLES)).collect();
    let positions: Vec<Vec3> =
        distances.iter().map(|d| DVec3::new(0.1, 0.0, foot - d).as_vec3()).collect();
    samples.write(gpu, &positions, &vec![Vec3::Y; SAMPLES as usize]).expect("lists that fit");
    let frame =
        Frame { samples: &samples, light: &light, casters: &meshes, origin: meshes.origin() };
    let mut technique = MapTechnique::new(gpu, &map, estimator).expect("a valid config");
    let target = samples.visibility_target(gpu).expect("a target");
    let view = target.create_view(&Default::default());
    technique.prepare(gpu, &frame).expect("prepared");
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    technique.encode(gpu, &frame, &mut Recorder::new(&mut encoder), &view).expect("encoded");
    gpu.queue.submit([encoder.finish()]);
    let visibility = read_f32_texture(gpu, &target, 0).expect("read back");

    let clip = technique.map().views()[0].clip.expect("a view with casters");
    let texel = |p: &Vec3| twin::locate(&clip, f64::from(map.size), p.as_dvec3(), DVec3::Y).texel;
    let first =
        twin::locate(&clip, f64::from(map.size), DVec3::new(0.1, 0.0, foot), DVec3::Y).texel;
    let in_texels: Vec<f64> = positions.iter().map(|p| texel(p).distance(first)).collect();
    contact_gap(&in_texels, &visibility, &vec![0.0; visibility.len()], 1.0).expect("a valid line")
}

fn estimators() -> Vec<(&'static str, Estimator)> {
    let valid = "a valid config";
    vec![
        ("plain", Estimator::nearest()),
        ("hardware", PcfHardware::default().estimator()),
        ("grid 3", PcfGrid::default().estimator().expect(valid)),
        ("grid 7", PcfGrid { side: 7, ..Default::default() }.estimator().expect(valid)),
        ("bilinear 3", PcfBilinearGrid::default().estimator().expect(valid)),
        ("bilinear 6", PcfBilinearGrid { side: 6, ..Default::default() }.estimator().expect(valid)),
        ("castano 5", PcfCastano::default().estimator().expect(valid)),
        ("castano 7", PcfCastano { side: 7, ..Default::default() }.estimator().expect(valid)),
        (
            "castano 7 hardware",
            PcfCastano { side: 7, hardware: true, ..Default::default() }.estimator().expect(valid),
        ),
        ("poisson", PcfPoisson::default().estimator().expect(valid)),
    ]
}

#[test]
fn shadows_begin_within_two_texels_and_the_kernel_radius_of_the_contact() {
    let gpu = gpu();
    for (scene, foot) in [(generate::thin_wall(), -0.005), (generate::cube_on_floor(), -0.5)] {
        for size in [128, 512, 2048] {
            for (name, estimator) in estimators() {
                let bound = 2.0 + f64::from(estimator.radius);
                let map = MapConfig { size, ..MapConfig::default() };
                let gap = gap(&gpu, &scene, foot, estimator, map);
                assert!(gap <= bound, "{}, {name}, {size}: {gap} texels", scene.name);
            }
        }
    }
}

#[test]
fn a_bias_too_large_opens_a_gap_that_is_noticed() {
    let gpu = gpu();
    let bias = Bias { slope: 20.0, receiver_plane: false, ..Bias::default() };
    let map = MapConfig { size: 512, bias };
    let gap = gap(&gpu, &generate::thin_wall(), -0.005, Estimator::nearest(), map);
    // 20 half texels of the floor's slope (1 at 45 degrees) against a wall that rises by 2 a texel.
    assert!(gap > 3.0, "{gap} texels");
}
