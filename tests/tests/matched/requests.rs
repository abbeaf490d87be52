//! Which pages are asked for.

use std::collections::{BTreeMap, BTreeSet};

use antumbra_measure::Stage;
use antumbra_sampling::ResolutionMatched;
use antumbra_sampling::matched::{Page, Virtual};
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Camera, Light, LightKind, Scene};
use antumbra_tests::gpu;
use glam::{DAffine3, DVec2, DVec3, Vec3};

use super::{built, layout, occupied, of_size, requests, shoot, stage, window, yard};

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
