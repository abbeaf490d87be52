//! Resolution-matched pages: which are asked for, drawn and kept, and how right the picture is that comes of them.

use std::any::Any;
use std::collections::{BTreeMap, BTreeSet};

use antumbra::Config;
use antumbra_filter::PcfBilinearGrid;
use antumbra_gpu::{Frame, Gpu, GpuError, Technique, TechniqueConfig};
use antumbra_map::{
    Arrange, Estimator, Fitting, Layout, MapConfig, MapTechnique, Plain, SeenView, Sight,
};
use antumbra_measure::stability::{CASES, Case};
use antumbra_measure::{Shot, Stage};
use antumbra_reference::{SampleClass, TruthOptions};
use antumbra_sampling::ResolutionMatched;
use antumbra_sampling::matched::{Limits, Page, Request, Standing, Virtual, pages_of, windows};
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Camera, Light, LightKind, Scene};
use antumbra_tests::gpu;
use glam::{DAffine3, DMat4, DVec2, DVec3, Vec3};

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

#[test]
fn a_still_frame_draws_nothing_and_a_moving_caster_only_what_it_touches() {
    let gpu = gpu();
    let light = Light::sun(1.0, 0.4, 0.0);
    let config = ResolutionMatched { page: 16, displacement: 0.5, ..of_size(1024) };
    let mut technique = built(&gpu, &config);
    let (first, second) = (stage(&gpu, &yard(0.0), 128), stage(&gpu, &yard(0.3), 128));
    let fresh = shoot(&gpu, &first, &light, &mut technique);
    let counters = &fresh.counters;
    let used = counters["pages_in_use"];
    assert!(used > 20, "{used} pages");
    assert_eq!((counters["pages_rendered"], counters["pages_reused"]), (used, 0), "at first");
    let occupied = counters["pages_requested"] - counters["pages_empty"];
    assert_eq!(occupied, used, "no page that no sample asks for or nothing lies on");

    let still = shoot(&gpu, &first, &light, &mut technique);
    assert_eq!(still.counters["pages_rendered"], 0, "a still frame");
    assert_eq!(
        (still.counters["pages_reused"], still.counters["page_triangles"]),
        (used, 0),
        "still"
    );
    assert_eq!(still.visibility, fresh.visibility, "the same picture");

    let moved = shoot(&gpu, &second, &light, &mut technique);
    let drawn = moved.counters["pages_rendered"];
    assert!(drawn > 0 && 2 * drawn < moved.counters["pages_in_use"], "{drawn} pages are touched");
    let alone = shoot(&gpu, &second, &light, &mut built(&gpu, &config));
    assert_eq!(moved.visibility, alone.visibility, "as if nothing had been kept");
    assert_ne!(moved.visibility, fresh.visibility, "the shadow moves");

    let turned = shoot(&gpu, &second, &Light::sun(1.0, 0.5, 0.0), &mut technique);
    let drawn = turned.counters["pages_rendered"];
    assert_eq!(drawn, turned.counters["pages_in_use"], "under another light all is drawn");
    assert_eq!(turned.counters["pages_reused"], 0, "and nothing kept");
    // And back: pages of a window that is no longer kept are not taken for its own.
    let back = shoot(&gpu, &first, &light, &mut technique);
    assert_eq!(back.visibility, fresh.visibility, "back");
}

#[test]
fn what_is_made_of_kept_pages_is_kept() {
    let gpu = gpu();
    let mut of = Config::Evsm(Default::default());
    of.set_map_size(1024);
    let config = ResolutionMatched { of, page: 64, table: 16, displacement: 0.5 };
    let light = Light::sun(1.0, 0.4, 0.0);
    let mut technique = built(&gpu, &config);
    let (first, second) = (stage(&gpu, &yard(0.0), 64), stage(&gpu, &yard(0.3), 64));
    let fresh = shoot(&gpu, &first, &light, &mut technique);
    let texels = fresh.counters["store_texels"];
    assert!(texels >= 2 * 1024 * 1024, "{texels} texels of two passes over the atlas");
    let still = shoot(&gpu, &first, &light, &mut technique);
    let counts = (still.counters["pages_rendered"], still.counters["store_texels"]);
    assert_eq!(counts, (0, 0), "a still frame");
    assert_eq!(still.counters["store_taps"], 0, "a still frame");
    assert_eq!(still.visibility, fresh.visibility, "the same picture");
    // What changes is made, then as when nothing had been kept.
    let turned = Light::sun(1.0, 0.5, 0.0);
    for (what, stage, light) in
        [("a caster", &second, &light), ("the light", &second, &turned), ("back", &first, &turned)]
    {
        let moved = shoot(&gpu, stage, light, &mut technique);
        assert_eq!(moved.counters["store_texels"], texels, "{what} moves");
        let alone = shoot(&gpu, stage, light, &mut built(&gpu, &config));
        // A page may have another slot, and places in the atlas, of 1024 texels, other roundings: of 2^-15 texels, in which
        // visibility changes by less than it would at an edge a thirtieth of a texel wide.
        let pairs = moved.visibility.iter().zip(&alone.visibility);
        let off = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off <= 1e-3, "{what} moves: {off} from the picture");
        assert_ne!(moved.visibility, fresh.visibility, "{what} moves: another picture");
        let still = shoot(&gpu, stage, light, &mut technique);
        assert_eq!(still.counters["store_texels"], 0, "{what} stands still");
        assert!(still.visibility == moved.visibility, "{what} stands still: the picture");
    }
}

#[test]
fn a_camera_that_moves_has_only_those_pages_drawn_that_nobody_asked_for_before() {
    let gpu = gpu();
    let scene = generate::by_name("street").expect("a scene");
    let camera = scene.camera_or_framing();
    let config = ResolutionMatched { page: 16, displacement: 0.5, ..of_size(1024) };
    for kind in [LightKind::Directional, LightKind::Spot] {
        let light = scene.light_or_placed(kind);
        let mut technique = built(&gpu, &config);
        let mut before = BTreeSet::new();
        let (mut drawn, mut reused) = (0, 0);
        for step in 0..6 {
            // Forwards by 20 cm a frame, and to the side.
            let by = (camera.target - camera.eye).normalize() * (0.2 * f64::from(step))
                + DVec3::new(0.1, 0.0, 0.05) * f64::from(step);
            let moved = Camera { eye: camera.eye + by, target: camera.target + by, ..camera };
            let stage = Stage::new(&gpu, &scene, moved, 96, 96).expect("a stage");
            let shot = shoot(&gpu, &stage, &light, &mut technique);
            let counters = &shot.counters;
            assert_eq!(counters["pages_clamped"], 0, "{kind:?}: an atlas that suffices");
            let requests = requests(&gpu, technique.as_ref());
            let pages: BTreeSet<Page> = occupied(&requests).into_keys().collect();
            // No more than the atlas holds are seen in all, so that none has left it.
            let new = pages.difference(&before).count() as u64;
            assert_eq!(counters["pages_rendered"], new, "{kind:?}, step {step}: new pages");
            assert_eq!(
                counters["pages_reused"],
                pages.len() as u64 - new,
                "{kind:?}, step {step}: the others"
            );
            let fresh = shoot(&gpu, &stage, &light, &mut built(&gpu, &config));
            assert_eq!(shot.visibility, fresh.visibility, "{kind:?}, step {step}: the picture");
            before.extend(pages);
            assert!(before.len() <= 4096, "{kind:?}: {} pages", before.len());
            if step > 0 {
                drawn += new;
                reused += counters["pages_reused"];
            }
        }
        assert!(drawn > 0, "{kind:?}: something comes into view");
        assert!(reused > 2 * drawn, "{kind:?}: {drawn} pages are drawn and {reused} kept");
    }
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

/// What the samples of a stage ask for, and how many: surely, and perhaps.
fn asked(stage: &Stage, light: &Light, map: &Virtual) -> [BTreeMap<Page, u32>; 2] {
    let clip = window(stage, light, map);
    let camera = stage.frame(light).camera.expect("a camera");
    let pixels = [stage.image.width, stage.image.height];
    let [mut surely, mut perhaps] = [BTreeMap::new(), BTreeMap::new()];
    for sample in stage.view_samples() {
        if sample.normal == Vec3::ZERO {
            continue;
        }
        let (p, n) = (sample.position.as_dvec3(), sample.normal.as_dvec3());
        let world = p + stage.triangles.origin;
        let to_light = light.towards(world, DVec2::splat(0.5)).normalize();
        let facing = n.dot(to_light);
        let c = clip * p.extend(1.0);
        let ndc = DVec2::new(c.x, c.y) / c.w;
        let st = DVec2::new(0.5 + 0.5 * ndc.x, 0.5 - 0.5 * ndc.y);
        let outside = |by: f64| c.w <= 0.0 || ndc.abs().max_element() > 1.0 + by;
        if facing <= -1e-6 || outside(1e-6) {
            continue;
        }
        let displacement = map.displacement(&clip, &camera, pixels, (p, n));
        // f32 knows a texel's sides to some 1e-4, and places to 1e-6 of the window: less than a tenth of a texel.
        let mut all = BTreeSet::new();
        for by in [-1e-3, 0.0, 1e-3] {
            let level = map.level(displacement * (1.0 + by));
            for [x, y] in [[-1e-6, -1e-6], [1e-6, -1e-6], [-1e-6, 1e-6], [1e-6, 1e-6]] {
                all.insert(map.page_of(
                    0,
                    (st + DVec2::new(x, y)).clamp(DVec2::ZERO, DVec2::ONE),
                    level,
                ));
            }
        }
        let is_sure = all.len() == 1 && facing > 1e-6 && !outside(-1e-6);
        for page in all {
            *perhaps.entry(page).or_default() += 1;
            *surely.entry(page).or_default() += u32::from(is_sure);
        }
    }
    surely.retain(|_, n| *n > 0);
    [surely, perhaps]
}

#[test]
fn pages_are_those_that_the_twin_asks_for() {
    let gpu = gpu();
    for name in ["street", "cube", "hall"] {
        let scene = generate::by_name(name).expect("a scene");
        let stage = stage(&gpu, &scene, 128);
        for kind in [LightKind::Directional, LightKind::Spot] {
            let light = scene.light_or_placed(kind);
            for rule in [1.0, 0.5] {
                let config = ResolutionMatched { page: 16, displacement: rule, ..of_size(1024) };
                let map = layout(&config, 1024);
                let mut technique = built(&gpu, &config);
                let shot = shoot(&gpu, &stage, &light, &mut technique);
                let requests = requests(&gpu, technique.as_ref());
                let found: BTreeMap<Page, u32> =
                    requests.iter().map(|r| (r.page, r.samples)).collect();
                let [surely, perhaps] = asked(&stage, &light, &map);
                let of = |counts: &BTreeMap<Page, u32>, page| counts.get(page).copied();
                let short = surely.iter().filter(|(page, n)| of(&found, page) < Some(**n)).count();
                let over = found.iter().filter(|(page, n)| of(&perhaps, page) < Some(**n)).count();
                assert_eq!((short, over), (0, 0), "{name}, {kind:?}: of {} pages", found.len());
                assert!(surely.len() > 3, "{name}, {kind:?}: {} say little", surely.len());
                assert_eq!(shot.counters["pages_requested"], found.len() as u64, "the count");
                let (least, used) = map.fitting(&occupied(&requests));
                assert_eq!(shot.counters["page_rank"], u64::from(least), "{name}: the rank");
                assert_eq!(shot.counters["pages_in_use"], used.len() as u64, "pages in use");
                // The control: what another rule asks for is something else.
                let other = Virtual { rule: 0.5 * rule, ..map };
                assert!(asked(&stage, &light, &other)[0] != surely, "{name}: another rule");
            }
        }
    }
}

/// The casters of a stage in the window of its light, whose points go from (0, 0) to (1, 1).
fn casters_in_window(stage: &Stage, light: &Light, map: &Virtual) -> Vec<[DVec2; 3]> {
    let clip = window(stage, light, map);
    let corner = |i: &u32| {
        let c = clip * stage.triangles.positions[*i as usize].as_dvec3().extend(1.0);
        assert!(c.w > 0.0, "no corner lies behind the light");
        DVec2::new(0.5 + 0.5 * c.x / c.w, 0.5 - 0.5 * c.y / c.w)
    };
    stage.triangles.triangles.iter().map(|t| [0, 1, 2].map(|k| corner(&t[k]))).collect()
}

/// Whether a triangle meets the square of a page that is wider by `by` of its sides all around: no line along a side of
/// either keeps them apart.
fn meets(triangle: &[DVec2; 3], map: &Virtual, page: &Page, by: f64) -> bool {
    let side = 1.0 / f64::from(map.table >> page.level);
    let middle = (DVec2::from(page.tile.map(f64::from)) + 0.5) * side;
    let reach = side * (0.5 + by);
    let sides = [0, 1, 2].map(|i| (triangle[(i + 1) % 3] - triangle[i]).perp());
    [DVec2::X, DVec2::Y].iter().chain(&sides).all(|axis| {
        let along = triangle.map(|corner| axis.dot(corner - middle));
        let (lo, hi) = along
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), x| (lo.min(*x), hi.max(*x)));
        let square = axis.abs().element_sum() * reach;
        lo <= square && hi >= -square
    })
}

#[test]
fn pages_without_casters_need_no_memory() {
    let gpu = gpu();
    let scene = yard(0.0);
    for light in [Light::sun(1.0, 0.4, 0.0), scene.place_light(LightKind::Spot)] {
        let stage = stage(&gpu, &scene, 128);
        let config = ResolutionMatched { page: 16, ..of_size(1024) };
        let map = layout(&config, 1024);
        let mut technique = built(&gpu, &config);
        let shot = shoot(&gpu, &stage, &light, &mut technique);
        let requests = requests(&gpu, technique.as_ref());
        let mut casters = casters_in_window(&stage, &light, &map);
        // The floor, 2 triangles, lies below all that casts and is none.
        casters.drain(..2);
        let surprises = |casters: &[[DVec2; 3]]| {
            // A border and a texel beyond a page casters are noticed; f32 knows places to 1e-6 of the window.
            let around = f64::from(map.border + 1) / f64::from(map.side());
            let off = |page: &Page| 2e-6 * f64::from(map.table >> page.level);
            let lies = |page: &Page, by| casters.iter().any(|t| meets(t, &map, page, by));
            let missed = requests.iter().filter(|r| !r.occupied && lies(&r.page, -off(&r.page)));
            let invented =
                requests.iter().filter(|r| r.occupied && !lies(&r.page, around + off(&r.page)));
            (missed.count(), invented.count())
        };
        assert_eq!(surprises(&casters), (0, 0), "{light:?}: of {} pages", requests.len());
        let empty = requests.iter().filter(|r| !r.occupied).count();
        assert_eq!(shot.counters["pages_empty"], empty as u64, "{light:?}");
        assert!(10 * empty > requests.len(), "{light:?}: {empty} of {}", requests.len());
        assert!(empty + 10 < requests.len(), "{light:?}: {empty} of {}", requests.len());
        // The control: casters that lie elsewhere, by a tenth of the window.
        let moved: Vec<[DVec2; 3]> = casters.iter().map(|t| t.map(|p| p + 0.1)).collect();
        let (missed, invented) = surprises(&moved);
        assert!(missed > 10 && invented > 10, "{light:?}: {missed}, {invented}");
    }
}

#[test]
fn a_wall_along_the_light_asks_for_a_column_of_the_finest_pages_and_no_more() {
    let gpu = gpu();
    // 99 m of wall under a sun that is 0.01 degrees off it, and two posts that make the window wide.
    let mut scene = Scene { name: "wall".to_owned(), ..Scene::default() };
    let wall = shapes::quad(DVec3::new(2.0, 2.0, 50.5), DVec3::new(0.0, 0.0, 49.5), 2.0 * DVec3::Y);
    scene.add(wall, DAffine3::IDENTITY);
    for x in [-20.0, 20.0] {
        let foot = DVec3::new(x, 0.0, 120.0);
        scene.add(shapes::cuboid(foot, foot + DVec3::ONE), DAffine3::IDENTITY);
    }
    scene.camera = Some(Camera {
        eye: DVec3::new(0.0, 1.7, 0.0),
        target: DVec3::new(2.0, 1.7, 10.0),
        up: DVec3::Y,
        fov_y: 0.9,
        near: 0.1,
    });
    let stage = stage(&gpu, &scene, 128);
    for off in [1e-2_f64, 0.0, -1e-2] {
        let off = off.to_radians();
        let direction = DVec3::new(off.sin(), -off.cos(), 0.0);
        let light = Light::Directional { direction, angular_diameter: 0.0 };
        let config = ResolutionMatched { page: 16, ..of_size(1024) };
        let mut technique = built(&gpu, &config);
        let shot = shoot(&gpu, &stage, &light, &mut technique);
        let pages: Vec<Page> =
            requests(&gpu, technique.as_ref()).iter().map(|request| request.page).collect();
        // One way or the other the wall shows the sun its back.
        let columns: BTreeSet<u32> =
            pages.iter().filter(|page| page.level == 0).map(|page| page.tile[0]).collect();
        let rows: BTreeSet<u32> =
            pages.iter().filter(|page| page.level == 0).map(|page| page.tile[1]).collect();
        assert!(columns.len().min(rows.len()) <= 2, "{off}: {} x {}", columns.len(), rows.len());
        assert!(pages.len() <= 3 * 256, "{off}: {} pages", pages.len());
        assert_eq!(shot.counters["pages_clamped"], 0, "{off}: they fit");
        assert!(shot.visibility.iter().all(|v| *v == 0.0 || *v == 1.0), "{off}: no number");
    }
}

/// One map over the window of pages whose finest level has so many texels a side.
#[derive(Debug)]
struct SameWindow(u32);

impl Arrange for SameWindow {
    fn layout(&self, light: &Light) -> Layout {
        Layout::of(light)
    }

    fn fit(
        &self,
        frame: &Frame<'_>,
        hull: &[DVec3],
        _: Option<&Sight<'_>>,
        fitting: &Fitting,
    ) -> Result<Vec<SeenView>, GpuError> {
        let (receivers, mut standing) = (fitting.receivers, Standing::default());
        Ok(windows(frame.light, hull, frame.origin, self.0, receivers, &mut standing))
    }
}

#[test]
fn pages_of_the_finest_level_are_the_plain_map_of_its_size() {
    let gpu = gpu();
    for name in ["street", "tree", "fence"] {
        let scene = generate::by_name(name).expect("a scene");
        let mut stage = stage(&gpu, &scene, 128);
        // All samples ask for the finest level.
        stage.set_camera(None);
        for kind in [LightKind::Directional, LightKind::Spot, LightKind::Point] {
            let light = scene.light_or_placed(kind);
            // 16 x 16 pages of 28 x 28 texels and their borders, of which the atlas holds 1024.
            let config = ResolutionMatched { page: 32, table: 16, ..of_size(1024) };
            let shot = shoot(&gpu, &stage, &light, &mut built(&gpu, &config));
            assert_eq!(shot.counters["pages_clamped"], 0, "{name}, {kind:?}: all fit");
            assert_eq!(layout(&config, 1024).texels(), 448, "of the finest level");
            let map = MapConfig { size: 448, ..MapConfig::default() };
            let mut plain =
                MapTechnique::arranged(&gpu, &map, Estimator::nearest(), Box::new(SameWindow(448)))
                    .expect("a valid config");
            let plain = stage.shoot(&gpu, &light, &mut plain, 0).expect("a shot").visibility;
            let differ = shot.visibility.iter().zip(&plain).filter(|(a, b)| a != b).count();
            // Vertices reach the rasteriser by other roundings, of some 2^-13 texels, which now and then is a step of
            // its grid, 1/256 texel; and of such a step one sample in a thousand near an edge takes notice.
            assert!(differ <= 4, "{name}, {kind:?}: {differ} of {} samples", plain.len());
        }
    }
}

/// Techniques with kernels, on maps of `size`.
fn filters(size: u32) -> Vec<(&'static str, Config)> {
    let grid = PcfBilinearGrid { side: 4, ..Default::default() };
    let mut all = vec![
        ("grid", Config::PcfBilinearGrid(grid)),
        ("castano", Config::PcfCastano(Default::default())),
        ("footprint", Config::PcfFootprint(Default::default())),
        ("evsm", Config::Evsm(Default::default())),
        ("msm", Config::Msm(Default::default())),
    ];
    for (_, config) in &mut all {
        config.set_map_size(size);
    }
    all
}

/// Visibility of a technique over one map of `size` texels a side in the window of pages of `finest`.
fn in_one_map(
    gpu: &Gpu,
    stage: &Stage,
    light: &Light,
    of: &Config,
    (size, finest): (u32, u32),
) -> Vec<f32> {
    let mut of = of.clone();
    of.set_map_size(size);
    let technique: Box<dyn Any> = of.build(gpu).expect("a valid config");
    let technique = technique.downcast::<MapTechnique>().expect("a map's technique");
    let window = Box::new(SameWindow(finest));
    let mut technique = technique.rearranged(|_| Ok(window)).expect("a window");
    stage.shoot(gpu, light, &mut technique, 0).expect("a shot").visibility
}

/// A place in the atlas is rounded to 2^-14 texels, and over a texel visibility changes by no more than 1, or by the few
/// that bounds make of it.
const SAME_PLACE: f32 = 1.0 / 2048.0;

#[test]
fn filters_over_pages_are_filters_over_one_map_of_the_same_texels() {
    let gpu = gpu();
    let scene = generate::by_name("street").expect("a scene");
    let mut stage = stage(&gpu, &scene, 128);
    stage.set_camera(None);
    for kind in [LightKind::Directional, LightKind::Point] {
        let light = scene.light_or_placed(kind);
        for (name, of) in filters(1024) {
            // Of six faces not all pages of large borders fit.
            if kind == LightKind::Point && name != "grid" {
                continue;
            }
            let config =
                ResolutionMatched { of: of.clone(), page: 64, table: 8, displacement: 0.5 };
            let mut technique = built(&gpu, &config);
            let shot = shoot(&gpu, &stage, &light, &mut technique);
            assert_eq!(shot.counters["pages_clamped"], 0, "{name}, {kind:?}: all fit");
            assert!(shot.counters["pages_in_use"] > 8, "{name}, {kind:?}: many borders");
            let texels =
                pages_of(technique.as_ref()).expect("pages").layout().expect("it").texels();
            let one = |size| in_one_map(&gpu, &stage, &light, &of, (size, size));
            let off = |a: &[f32], b: &[f32]| {
                a.iter().zip(b).filter(|(a, b)| (*a - *b).abs() > SAME_PLACE).count()
            };
            let differ = off(&shot.visibility, &one(texels));
            // What the rasteriser makes of other roundings, a sample in a thousand notices. Four moments make more of any
            // rounding where depth hardly varies: there it is the mean that counts.
            let count = shot.visibility.len();
            assert!(differ <= 16 || name == "msm", "{name}, {kind:?}: {differ} of {count} differ");
            let mean = |a: &[f32], b: &[f32]| {
                let sum: f32 = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum();
                sum / a.len() as f32
            };
            let by = mean(&shot.visibility, &one(texels));
            assert!(by <= SAME_PLACE, "{name}, {kind:?}: by {by} on average");
            // The control: texels that are a seventh smaller.
            let other = off(&shot.visibility, &one(texels * 8 / 7));
            assert!(other > 100, "{name}, {kind:?}: other texels make {other} differ");
        }
    }
}

/// As seen by a camera, with pages of several levels: next to a page's border a sample is what it is in one map of its
/// level's texels, as it is elsewhere.
#[test]
fn kernels_across_borders_of_pages_see_what_they_see_in_one_map() {
    let gpu = gpu();
    let scene = generate::by_name("street").expect("a scene");
    let stage = stage(&gpu, &scene, 128);
    let light = scene.light_or_placed(LightKind::Directional);
    for (name, of) in filters(1024) {
        let config = ResolutionMatched { of: of.clone(), page: 64, table: 16, displacement: 4.0 };
        // How far samples are off on average, far from borders and where kernels reach across them.
        let off = |border| {
            let limits = Limits { border, ..Limits::default() };
            let mut technique = config.build_within(&gpu, limits).expect("a valid config");
            let shot = shoot(&gpu, &stage, &light, &mut technique);
            let pages = pages_of(technique.as_ref()).expect("pages");
            let map = *pages.layout().expect("casters");
            let of_map: &dyn Any = technique.as_ref();
            let of_map = of_map.downcast_ref::<MapTechnique>().expect("a map's technique");
            let reach = f64::from(of_map.map().guard());
            let lookups = pages.read_lookups(&gpu).expect("read back");
            let levels: BTreeSet<u32> = lookups.iter().flatten().map(|page| page.level).collect();
            assert!(levels.len() > 1, "{name}: levels {levels:?}");
            let clip = window(&stage, &light, &map);
            let mut means = [(0.0, 0); 2];
            for level in levels {
                let sizes = (map.texels() >> level, map.texels());
                let one = in_one_map(&gpu, &stage, &light, &of, sizes);
                for (i, sample) in stage.view_samples().iter().enumerate() {
                    let Some(page) = lookups[i].filter(|page| page.level == level) else {
                        continue;
                    };
                    let ndc = clip.project_point3(sample.position.as_dvec3());
                    let st = DVec2::new(0.5 + 0.5 * ndc.x, 0.5 - 0.5 * ndc.y);
                    let tile = DVec2::from(page.tile.map(f64::from));
                    let inside =
                        (st * f64::from(map.table >> level) - tile) * f64::from(map.side());
                    let edge = inside.min(f64::from(map.side()) - inside).min_element();
                    let (sum, count) = &mut means[usize::from(edge < reach)];
                    *sum += f64::from((shot.visibility[i] - one[i]).abs());
                    *count += 1;
                }
            }
            means.map(|(sum, count)| {
                assert!(count > 500, "{name}: {count} samples");
                sum / f64::from(count)
            })
        };
        let same = f64::from(SAME_PLACE);
        let [elsewhere, across] = off(u32::MAX);
        assert!(elsewhere.max(across) <= same, "{name}: off by {elsewhere}, {across} at borders");
        // The control: pages without borders.
        let [elsewhere, across] = off(0);
        assert!(elsewhere <= same && across > 5.0 * same, "{name}: {elsewhere}, {across}");
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

/// At sizes at which the tests of all techniques do not try it.
#[test]
fn hard_cases_are_as_expected() {
    let gpu = gpu();
    let mut surprises = Vec::new();
    for size in [128, 512] {
        let config = of_size(size);
        // Lights with an extent are for soft shadows, casters that let light through for `volume/translucent`.
        let others =
            |case: &&Case| ["area light", "HC-36"].iter().any(|kind| case.name.starts_with(kind));
        for case in CASES.iter().filter(|case| !others(case)) {
            let mut technique = config.build(&gpu).expect("a valid config");
            let measured = case.measure(&gpu, technique.as_mut(), size);
            let expected = config.expectation(case.name);
            let met = match (&measured, expected) {
                (Ok(number), Some(expected)) => expected.is_met_by(*number),
                _ => false,
            };
            if !met {
                surprises.push(format!("{} at {size}: {measured:?}, not {expected:?}", case.name));
            }
        }
    }
    assert!(surprises.is_empty(), "not as expected:\n{}", surprises.join("\n"));
}
