//! Maps of their own for single objects: finer, each with its own casters only, and together they hold all shadows.

use antumbra_filter::{PcfHardware, Vsm};
use antumbra_gpu::{Frame, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{
    Arrange, Estimator, Fitting, Layout, MapConfig, MapTechnique, Omni, PerObject, Plain, SeenView,
    Sight,
};
use antumbra_measure::{Shot, Stage, stability};
use antumbra_reference::{Comparison, Metrics, TruthOptions, ViewSample};
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Light, Scene};
use antumbra_tests::gpu;
use glam::{DAffine3, DVec3, Vec3};

/// Four boxes far apart over a floor, and samples of the floor around each.
fn far_apart() -> (Scene, Vec<ViewSample>) {
    let mut scene = Scene::default();
    scene.add(shapes::floor(60.0), DAffine3::IDENTITY);
    let mut samples = Vec::new();
    for (x, z) in [(-40.0, -30.0), (40.0, -35.0), (-30.0, 40.0), (35.0, 38.0)] {
        let center = DVec3::new(x, 1.0, z);
        scene.add(shapes::cuboid(center - 0.5, center + 0.5), DAffine3::IDENTITY);
        samples.extend((1..=4096).map(|i| {
            // Roberts 2018, in the plane.
            let at = [0.754_877_666, 0.569_840_291].map(|g| (f64::from(i) * g).fract());
            let position = DVec3::new(x + 5.0 * at[0] - 2.5, 0.0, z + 5.0 * at[1] - 2.5);
            ViewSample { position: position.as_vec3(), normal: Vec3::Y }
        }));
    }
    (scene, samples)
}

fn lights() -> [Light; 2] {
    [
        Light::sun(1.0, 0.5, 0.0),
        Light::Spot {
            position: DVec3::new(0.0, 60.0, 5.0),
            direction: DVec3::NEG_Y,
            outer_angle: 0.9,
        },
    ]
}

fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, technique: &mut dyn Technique) -> Shot {
    stage.shoot(gpu, light, technique, 0).expect("a shot")
}

fn metrics(stage: &Stage, light: &Light, shot: &Shot) -> Metrics {
    let truth = stage.truth(light, &TruthOptions::default());
    let comparison = Comparison {
        estimate: &shot.visibility,
        reference: &truth.visibility,
        classes: &truth.class,
        width: stage.image.width as usize,
    };
    comparison.metrics().expect("comparable")
}

fn plain(size: u32, objects: u32) -> Plain {
    Plain { map: MapConfig { size, objects, ..MapConfig::default() } }
}

#[test]
fn objects_far_apart_have_finer_maps_and_each_its_own_casters() {
    let gpu = gpu();
    let (scene, samples) = far_apart();
    let stage = Stage::at_points(&gpu, &scene, &samples).expect("a stage");
    for light in lights() {
        let run = |size: u32, objects: u32| {
            let mut technique = plain(size, objects).build(&gpu).expect("a valid config");
            let shot = shoot(&gpu, &stage, &light, technique.as_mut());
            (metrics(&stage, &light, &shot).mean_abs, shot.counters)
        };
        let (one, _) = run(256, 0);
        let (coarse, work) = run(256, 4);
        let (fine, _) = run(1024, 4);
        assert_eq!((work["map_passes"], work["map_triangles"]), (4, 48), "{light:?}: a box a map");
        // The boxes span 80 m and each 1.8 m at most: texels are 40 times as fine, and errors go with them; 4 samples of
        // 16384 are left to chance.
        assert!(coarse <= one / 20.0 + 2.5e-4, "{light:?}: {coarse}, with one map {one}");
        assert!(one > 0.01, "{light:?}: one map is coarse: {one}");
        assert!(fine <= 0.5 * coarse + 2.5e-4, "{light:?}: {fine} at 1024 texels, {coarse} at 256");
        // Two that share a map, and more maps than objects.
        for (objects, passes) in [(2, 2), (7, 4)] {
            let (error, work) = run(1024, objects);
            assert_eq!(work["map_passes"], passes, "{light:?}: {objects} maps");
            assert!(error < 0.01, "{light:?}: error {error} with {objects} maps");
        }
    }
}

/// [`PerObject`] without its last map.
#[derive(Debug)]
struct OneLost(PerObject);

impl Arrange for OneLost {
    fn layout(&self, light: &Light) -> Layout {
        self.0.layout(light)
    }
    fn fit(
        &self,
        frame: &Frame<'_>,
        hull: &[DVec3],
        sight: Option<&Sight<'_>>,
        fitting: &Fitting,
    ) -> Result<Vec<SeenView>, GpuError> {
        let mut views = self.0.fit(frame, hull, sight, fitting)?;
        if let Some(last) = views.last_mut() {
            last.view.clip = None;
        }
        Ok(views)
    }
}

/// The control: without one of the maps, shadows are lost.
#[test]
fn a_lost_map_is_seen() {
    let gpu = gpu();
    let (scene, samples) = far_apart();
    let stage = Stage::at_points(&gpu, &scene, &samples).expect("a stage");
    let arrange = OneLost(PerObject { most: 4, omni: Omni::default() });
    let config = MapConfig { size: 1024, ..MapConfig::default() };
    for light in lights() {
        let mut technique = MapTechnique::arranged(
            &gpu,
            &config,
            Estimator::nearest(),
            Box::new(OneLost(arrange.0)),
        )
        .expect("a valid config");
        let shot = shoot(&gpu, &stage, &light, &mut technique);
        let error = metrics(&stage, &light, &shot).mean_abs;
        assert!(error > 0.01, "{light:?}: error {error}");
    }
}

#[test]
fn what_a_camera_sees_is_no_coarser_than_through_one_map() {
    let gpu = gpu();
    for name in ["street", "hall", "cube", "tree"] {
        let scene = generate::by_name(name).expect("a generated scene");
        let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 96, 96).expect("a stage");
        let light = scene.lights[0];
        let light = match light {
            Light::Directional { direction, .. } => {
                Light::Directional { direction, angular_diameter: 0.0 }
            }
            other => other,
        };
        let map = |objects| MapConfig { size: 512, objects, ..MapConfig::default() };
        let pairs: [[Box<dyn TechniqueConfig>; 2]; 2] = [
            [0, 8].map(|objects| Box::new(Plain { map: map(objects) }) as Box<dyn TechniqueConfig>),
            [0, 8].map(|objects| {
                Box::new(PcfHardware { map: map(objects), ..Default::default() })
                    as Box<dyn TechniqueConfig>
            }),
        ];
        for [one, many] in pairs {
            let [one, many] = [one, many].map(|config| {
                let mut technique = config.build(&gpu).expect("a valid config");
                let shot = shoot(&gpu, &stage, &light, technique.as_mut());
                metrics(&stage, &light, &shot).mean_abs
            });
            // Where texels' centres fall is chance, as in the fit's own test.
            assert!(many <= 1.33 * one + 7e-4, "{name}: {many}, with one map {one}");
        }
    }
}

/// A mask knows one view a sample.
#[test]
fn where_several_views_are_looked_up_nothing_is_masked() {
    let gpu = gpu();
    let (scene, samples) = far_apart();
    let stage = Stage::at_points(&gpu, &scene, &samples).expect("a stage");
    let [masked, whole] = [true, false].map(|receiver_mask| {
        let config = MapConfig { size: 256, receiver_mask, ..MapConfig::default() };
        let arrange = Box::new(PerObject { most: 4, omni: Omni::default() });
        let mut technique =
            MapTechnique::arranged(&gpu, &config, Estimator::nearest(), arrange).expect("valid");
        shoot(&gpu, &stage, &lights()[0], &mut technique)
    });
    assert!(masked.visibility == whole.visibility, "the same visibility");
    assert_eq!(masked.counters, whole.counters, "the same work");
}

#[test]
fn hard_cases_are_as_through_one_map() {
    let gpu = gpu();
    let config = plain(128, 8);
    let mut judged = 0;
    for case in stability::CASES {
        let Some(expected) = config.expectation(case.name) else { continue };
        let mut technique = config.build(&gpu).expect("a valid config");
        let number = case.measure(&gpu, technique.as_mut(), 128).expect("measured");
        assert!(expected.is_met_by(number), "{}: {number}, not {expected:?}", case.name);
        judged += 1;
    }
    assert!(judged > 40, "{judged} cases");
}

#[test]
fn settings_that_cannot_be_are_refused() {
    let gpu = gpu();
    let refused = |config: &dyn TechniqueConfig| {
        let fault = config.build(&gpu).err().expect("an error");
        assert!(matches!(fault, GpuError::Invalid { .. }), "{fault}");
    };
    refused(&plain(256, 65));
    let map = MapConfig { objects: 2, receiver_mask: true, ..MapConfig::default() };
    refused(&Plain { map });
    let map = MapConfig { objects: 2, ..MapConfig::default() };
    assert!(Vsm { map, ..Default::default() }.build(&gpu).is_ok(), "stores are layer by layer");
}
