//! Lone receivers: whatever faces the light is lit, at every map size, kernel and light, with default bias.

use antumbra::{Config, catalogue};
use antumbra_filter::{PcfBilinearGrid, PcfCastano, PcfGrid, PcfPoisson};
use antumbra_gpu::Gpu;
use antumbra_map::{Bias, MapConfig, MapTechnique};
use antumbra_measure::Stage;
use antumbra_scene::{Light, LightKind, Scene, generate};
use antumbra_tests::gpu;

/// Samples that face the light, and how many of them are not fully lit.
fn acne(stage: &Stage, light: &Light, visibility: &[f32]) -> (usize, usize) {
    let origin = stage.triangles.origin;
    let mut facing = 0;
    let mut dark = 0;
    for (sample, v) in stage.view_samples().iter().zip(visibility) {
        if sample.normal == glam::Vec3::ZERO {
            continue;
        }
        let p = origin + sample.position.as_dvec3();
        let to_light = light.towards(p, glam::DVec2::splat(0.5));
        // 1e-4: seen edge-on within f32 the sign of the cosine is the rounding's.
        if sample.normal.as_dvec3().dot(to_light.normalize()) > 1e-4 {
            facing += 1;
            dark += usize::from(*v < 1.0);
        }
    }
    (facing, dark)
}

fn techniques(size: u32) -> Vec<Config> {
    let map = MapConfig { size, ..MapConfig::default() };
    let mut all = catalogue();
    all.extend([
        Config::PcfGrid(PcfGrid { side: 7, map }),
        Config::PcfBilinearGrid(PcfBilinearGrid { side: 6, map }),
        Config::PcfCastano(PcfCastano { side: 7, map, hardware: false }),
        Config::PcfCastano(PcfCastano { side: 7, map, hardware: true }),
        Config::PcfPoisson(PcfPoisson { radius: 3.5, map, ..Default::default() }),
    ]);
    for config in &mut all {
        *config.map_mut() = map;
    }
    all
}

fn stage(gpu: &Gpu, scene: &Scene) -> Stage {
    let mut stage = Stage::new(gpu, scene, scene.camera_or_framing(), 192, 192).expect("a stage");
    stage.meshes.set_culling(false);
    stage
}

#[test]
fn lone_convex_receivers_have_no_acne() {
    let gpu = gpu();
    for (name, build, _) in generate::CONVEX {
        let scene = build();
        let stage = stage(&gpu, &scene);
        for kind in [LightKind::Directional, LightKind::Spot, LightKind::Point] {
            let light = scene.place_light(kind);
            for size in [128, 1024, 4096] {
                for config in techniques(size) {
                    let mut technique = config.build(&gpu).expect("a valid config");
                    let shot = stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot");
                    let (facing, dark) = acne(&stage, &light, &shot.visibility);
                    assert!(facing > 0, "{name}: no sample faces the light");
                    assert_eq!(dark, 0, "{name}, {kind:?}, {config:?}: of {facing}");
                }
            }
        }
    }
}

#[test]
fn a_plane_lit_at_five_degrees_has_no_acne() {
    let gpu = gpu();
    for azimuth in [0.0, std::f64::consts::FRAC_PI_4] {
        let scene = generate::grazing_plane(azimuth);
        let stage = stage(&gpu, &scene);
        let light = scene.lights[0];
        for size in [128, 512, 1024, 2048, 4096] {
            for config in techniques(size) {
                let mut technique = config.build(&gpu).expect("a valid config");
                let shot = stage.shoot(&gpu, &light, technique.as_mut(), 0).expect("a shot");
                let (facing, dark) = acne(&stage, &light, &shot.visibility);
                assert!(facing > 10_000, "the plane fills the view: {facing}");
                assert_eq!(dark, 0, "{config:?}: of {facing}");
            }
        }
    }
}

#[test]
fn without_bias_half_of_a_sloped_plane_is_in_false_shadow() {
    let gpu = gpu();
    let scene = generate::grazing_plane(0.0);
    let stage = stage(&gpu, &scene);
    let map = MapConfig { size: 1024, bias: Bias::NONE };
    let mut technique = MapTechnique::plain(&gpu, &map).expect("a valid config");
    let shot = stage.shoot(&gpu, &scene.lights[0], &mut technique, 0).expect("a shot");
    let (facing, dark) = acne(&stage, &scene.lights[0], &shot.visibility);
    // Each texel is split by its centre's depth: one half.
    let rate = dark as f64 / facing as f64;
    assert!((rate - 0.5).abs() < 0.02, "false shadow on {rate} of the plane");
}
