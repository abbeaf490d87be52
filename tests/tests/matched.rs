//! Resolution-matched pages: which are asked for, drawn and kept, and how right the picture is that comes of them.

#[path = "matched/borders.rs"]
mod borders;
#[path = "matched/kept.rs"]
mod kept;
#[path = "matched/requests.rs"]
mod requests;

use std::collections::BTreeMap;

use antumbra::Config;
use antumbra_filter::PcfBilinearGrid;
use antumbra_gpu::{Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{MapConfig, Plain};
use antumbra_measure::stability::{CASES, Kind};
use antumbra_measure::{Shot, Stage};
use antumbra_reference::{SampleClass, TruthOptions};
use antumbra_sampling::ResolutionMatched;
use antumbra_sampling::matched::{Limits, Page, Request, Standing, Virtual, pages_of, windows};
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Camera, Light, LightKind, Scene};
use antumbra_tests::gpu;
use glam::{DAffine3, DMat4, DVec3};

const TIES: TruthOptions = TruthOptions {
    light_samples: 1,
    ties: true,
    tie_distance: 1e-5,
    position_error: 1.0 / (1 << 21) as f64,
    seed: 0,
};

fn stage(gpu: &Gpu, scene: &Scene, side: u32) -> Stage {
    Stage::new(gpu, scene, scene.camera_or_framing(), side, side).expect("a stage")
}

fn of_size(size: u32) -> ResolutionMatched {
    let of = Plain { map: MapConfig { size, ..MapConfig::default() } };
    ResolutionMatched { of, ..Default::default() }
}

/// The virtual map of a config in an atlas of `size`, for a kernel of one texel.
fn layout(config: &ResolutionMatched, size: u32) -> Virtual {
    config.layout(size, 2).expect("a valid config")
}

fn built(gpu: &Gpu, config: &dyn TechniqueConfig) -> Box<dyn Technique> {
    config.build(gpu).expect("a valid config")
}

fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, technique: &mut Box<dyn Technique>) -> Shot {
    stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot")
}

/// What was asked for last.
fn requests(gpu: &Gpu, technique: &dyn Technique) -> Vec<Request> {
    pages_of(technique).expect("pages").read_requests(gpu).expect("read back")
}

/// The pages on which something lies, and the samples that ask for them.
fn occupied(requests: &[Request]) -> BTreeMap<Page, u32> {
    requests.iter().filter(|r| r.occupied).map(|r| (r.page, r.samples)).collect()
}

/// Share of the counted samples that are wrong.
fn wrong(stage: &Stage, light: &Light, visibility: &[f32]) -> f64 {
    let truth = stage.truth(light, &TIES);
    let counted: Vec<usize> =
        (0..visibility.len()).filter(|&i| truth.class[i] == SampleClass::Counted).collect();
    let dark = counted.iter().filter(|&&i| truth.visibility[i] == 0.0).count();
    assert!(20 * dark > counted.len(), "{dark} of {} samples are dark", counted.len());
    let wrong = counted.iter().filter(|&&i| truth.visibility[i] != visibility[i]).count();
    wrong as f64 / counted.len() as f64
}

/// A floor, two posts at its corners that cast over all of it, and a small box at `x`.
fn yard(x: f64) -> Scene {
    let mut scene = Scene { name: "yard".to_owned(), ..Scene::default() };
    scene.add(shapes::floor(8.0), DAffine3::IDENTITY);
    for corner in [DVec3::new(-7.0, 0.0, -7.0), DVec3::new(6.0, 0.0, 6.0)] {
        scene.add(shapes::cuboid(corner, corner + DVec3::new(1.0, 3.0, 1.0)), DAffine3::IDENTITY);
    }
    let low = DVec3::new(x, 0.5, 0.0);
    scene.add(shapes::cuboid(low, low + DVec3::splat(0.5)), DAffine3::IDENTITY);
    scene.camera = Some(Camera {
        eye: DVec3::new(0.0, 9.0, 9.0),
        target: DVec3::ZERO,
        up: DVec3::Y,
        fov_y: 1.2,
        near: 0.1,
    });
    scene
}

/// The window of a light that is no point, as a new technique has it.
fn window(stage: &Stage, light: &Light, map: &Virtual) -> DMat4 {
    use antumbra_gpu::Casters as _;
    let mut hull = Vec::new();
    stage.meshes.hull(light, &mut |p| hull.push(p));
    let (origin, mut standing) = (stage.triangles.origin, Standing::default());
    let views = windows(light, &hull, origin, map.texels(), false, &mut standing);
    views[0].view.clip.expect("casters")
}

#[test]
fn few_samples_of_a_street_are_wrong() {
    let gpu = gpu();
    let scene = generate::by_name("street").expect("a scene");
    let stage = stage(&gpu, &scene, 512);
    for kind in [LightKind::Directional, LightKind::Spot] {
        let light = scene.light_or_placed(kind);
        let matched = |size| {
            let shot = shoot(&gpu, &stage, &light, &mut built(&gpu, &of_size(size)));
            (wrong(&stage, &light, &shot.visibility), shot.counters)
        };
        let plain = |size| {
            let map = MapConfig { size, ..MapConfig::default() };
            let mut plain = Plain { map }.build(&gpu).expect("a valid config");
            let shot = stage.shoot(&gpu, &light, plain.as_mut(), 0).expect("a shot");
            wrong(&stage, &light, &shot.visibility)
        };
        let [(little, few), (share, counters)] = [2048, 4096].map(matched);
        assert!(share <= 5e-3, "{kind:?}: {share} of the samples are wrong");
        assert_eq!(counters["pages_clamped"], 0, "{kind:?}: an atlas that suffices");
        let occupied = counters["pages_requested"] - counters["pages_empty"];
        assert_eq!(counters["pages_in_use"], occupied, "{kind:?}: no others");
        assert_eq!(few["pages_requested"], counters["pages_requested"], "{kind:?}: as many");
        // As much memory without pages does worse; and what does badly is found out.
        let [as_little, as_large, small] = [2048, 4096, 64].map(plain);
        assert!(
            as_little > little,
            "{kind:?}: {as_little} of a plain map are wrong, here {little}"
        );
        assert!(as_large > share, "{kind:?}: {as_large} of a plain map are wrong, here {share}");
        assert!(small > 5e-3, "{kind:?}: {small} of a map of 64 texels a side are wrong");
    }
}

#[test]
fn half_the_displacement_leaves_half_of_the_error() {
    let gpu = gpu();
    let scene = generate::by_name("tree").expect("a scene");
    let stage = stage(&gpu, &scene, 256);
    let light = scene.light_or_placed(LightKind::Directional);
    let shares = [1.0, 0.5, 0.25].map(|displacement| {
        let config = ResolutionMatched { displacement, ..of_size(4096) };
        let shot = shoot(&gpu, &stage, &light, &mut built(&gpu, &config));
        assert_eq!(shot.counters["pages_clamped"], 0, "{displacement}: an atlas that suffices");
        wrong(&stage, &light, &shot.visibility)
    });
    // Some thousand wrong samples are their expected number to within a tenth; and shares of levels change with the rule.
    for pair in shares.windows(2) {
        let ratio = pair[0] / pair[1];
        assert!((1.5..=2.7).contains(&ratio), "{shares:?}");
    }
}

#[test]
fn techniques_that_look_farther_than_a_kernel_or_draw_their_own_map_are_refused_with_a_fix() {
    let gpu = gpu();
    let none: [Config; 4] = [
        Config::Pcss(Default::default()),
        Config::OcclusionTextures(Default::default()),
        Config::SecondDepth(Default::default()),
        Config::VolumeZFail(Default::default()),
    ];
    for of in none {
        let id = of.id();
        let config = ResolutionMatched { of, page: 64, table: 64, displacement: 0.5 };
        let refused = config.build(&gpu).map(|_| ());
        assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{id}: {refused:?}");
    }
    // And an atlas in which no page fits.
    let mut config = ResolutionMatched {
        of: Config::PcfBilinearGrid(PcfBilinearGrid { side: 6, ..Default::default() }),
        page: 64,
        table: 64,
        displacement: 0.5,
    };
    config.set_map_size(64);
    let scene = generate::by_name("street").expect("a scene");
    let stage = stage(&gpu, &scene, 16);
    let light = scene.light_or_placed(LightKind::Directional);
    let refused = stage.shoot(&gpu, &light, built(&gpu, &config).as_mut(), 0).map(|_| ());
    assert!(refused.is_err(), "an atlas of 64 texels a side");
    assert_eq!(gpu.check(), Ok(()), "nothing reached wgpu");
}

#[test]
fn memory_that_does_not_suffice_makes_pages_coarser_and_more_of_it_changes_nothing() {
    let gpu = gpu();
    let scene = generate::by_name("street").expect("a scene");
    let stage = stage(&gpu, &scene, 128);
    let light = scene.light_or_placed(LightKind::Directional);
    // Pages of 16 x 16 texels whatever the atlas.
    let shot = |size, displacement| {
        let config = ResolutionMatched { page: 16, displacement, ..of_size(size) };
        assert_eq!(layout(&config, size).page, 16, "an atlas of {size}");
        shoot(&gpu, &stage, &light, &mut built(&gpu, &config))
    };
    let [small, large] = [512, 1024].map(|size| shot(size, 1.0));
    assert_eq!(small.counters["pages_clamped"], 0, "{:?}", small.counters);
    assert_eq!(small.visibility, large.visibility, "more memory than it takes");

    let [little, enough] = [256, 1024].map(|size| shot(size, 0.25));
    assert_eq!(enough.counters["pages_clamped"], 0, "{:?}", enough.counters);
    let counters = &little.counters;
    assert!(counters["pages_in_use"] <= 256 && counters["page_rank"] > 0, "{counters:?}");
    assert!(counters["pages_clamped"] > 256, "{counters:?}");
    assert_eq!(counters["pages_requested"], enough.counters["pages_requested"], "as many asked");
    for shot in [&little, &enough] {
        let share = wrong(&stage, &light, &shot.visibility);
        assert!(share <= 5e-3, "{share} of the samples are wrong");
    }
}

/// Where not all has room that is asked for, and a plain map fits its window to the one object that there is.
#[test]
fn an_atlas_that_does_not_suffice_is_no_worse_than_a_plain_map_of_its_size() {
    let gpu = gpu();
    let scene = generate::by_name("tree").expect("a scene");
    let stage = stage(&gpu, &scene, 256);
    for kind in [LightKind::Directional, LightKind::Spot, LightKind::Point] {
        let light = scene.light_or_placed(kind);
        let config = of_size(1024);
        let shot = shoot(&gpu, &stage, &light, &mut built(&gpu, &config));
        let counters = &shot.counters;
        let suffices = counters["pages_requested"] - counters["pages_empty"] <= 256;
        assert!(!suffices && counters["pages_clamped"] > 0, "{kind:?}: {counters:?}");
        let matched = wrong(&stage, &light, &shot.visibility);
        let plain = |size| {
            let map = MapConfig { size, ..MapConfig::default() };
            let mut plain = Plain { map }.build(&gpu).expect("a valid config");
            let shot = stage.shoot(&gpu, &light, plain.as_mut(), 0).expect("a shot");
            wrong(&stage, &light, &shot.visibility)
        };
        let (same, larger) = (plain(1024), plain(4096));
        assert!(matched <= same, "{kind:?}: {matched} of the samples are wrong, else {same}");
        // The control: a map of 16 times the memory does better.
        assert!(matched > larger, "{kind:?}: {matched} of the samples are wrong, else {larger}");
    }
}

#[test]
fn pages_whose_lists_have_no_room_are_drawn_all_the_same() {
    let gpu = gpu();
    let scene = generate::by_name("tree").expect("a scene");
    let stage = stage(&gpu, &scene, 64);
    let light = scene.light_or_placed(LightKind::Directional);
    let config = of_size(512);
    let usual = shoot(&gpu, &stage, &light, &mut built(&gpu, &config));
    assert_eq!(usual.counters["pages_without_list"], 0, "room for all");
    for room in [1, 300] {
        let limits = Limits { pairs: room, ..Limits::default() };
        let mut technique = config.build_within(&gpu, limits).expect("a valid config");
        let shot = shoot(&gpu, &stage, &light, &mut technique);
        assert!(shot.counters["pages_without_list"] > 0, "room for {room} pairs");
        assert_eq!(shot.visibility, usual.visibility, "room for {room} pairs");
    }
}

#[test]
fn without_casters_all_is_lit_and_no_page_is_made() {
    let gpu = gpu();
    let scene = generate::grazing_plane(0.0);
    let stage = stage(&gpu, &scene, 16);
    for kind in [LightKind::Directional, LightKind::Spot, LightKind::Point] {
        let light = generate::cube_on_floor().place_light(kind);
        let mut technique = built(&gpu, &of_size(1024));
        let shot = shoot(&gpu, &stage, &light, &mut technique);
        assert!(shot.visibility.iter().all(|v| *v == 1.0), "{kind:?}: not all lit");
        assert_eq!((shot.counters["map_draws"], shot.counters["map_passes"]), (0, 0), "{kind:?}");
        // Six matrices, at most 256 bytes apart, and the setup.
        assert!(shot.bytes <= 6 * 256 + 1024, "{kind:?}: {} bytes", shot.bytes);
    }
}

#[test]
fn unusable_settings_are_refused_with_a_fix() {
    let gpu = gpu();
    let usual: ResolutionMatched = ResolutionMatched::default();
    for config in [
        ResolutionMatched { page: 0, ..usual },
        ResolutionMatched { page: 96, ..usual },
        ResolutionMatched { page: 2048, ..usual },
        ResolutionMatched { table: 0, ..usual },
        ResolutionMatched { table: 100, ..usual },
        ResolutionMatched { table: 2048, ..usual },
        ResolutionMatched { displacement: 0.0, ..usual },
        ResolutionMatched { displacement: f32::NAN, ..usual },
        ResolutionMatched { displacement: 65.0, ..usual },
    ] {
        let refused = config.build(&gpu).map(|_| ());
        assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{config:?}: {refused:?}");
    }
    assert_eq!(gpu.check(), Ok(()), "nothing reached wgpu");
}

/// At a size at which the tests of all techniques do not try it.
#[test]
fn hard_cases_are_as_expected() {
    const MAP: u32 = 512;
    let gpu = gpu();
    let mut surprises = Vec::new();
    let config = of_size(MAP);
    // Lights with an extent are for soft shadows, casters that let light through for `volume/translucent`.
    let others = [Kind::AreaLight, Kind::Translucency];
    for case in CASES.iter().filter(|case| !others.contains(&case.kind)) {
        let mut technique = config.build(&gpu).expect("a valid config");
        let measured = case.measure(&gpu, technique.as_mut(), MAP);
        let expected = config.expectation(case.name);
        let met = match (&measured, expected) {
            (Ok(number), Some(expected)) => expected.is_met_by(*number),
            _ => false,
        };
        if !met {
            surprises.push(format!("{}: {measured:?}, not {expected:?}", case.name));
        }
    }
    assert!(surprises.is_empty(), "not as expected:\n{}", surprises.join("\n"));
}
