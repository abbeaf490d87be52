//! View-sample mapping: exact at any resolution of its grid, against ray-traced truth and volumes asked one by one.

use antumbra_gpu::{Casters, Drawn, Frame, Gpu, LightView, Recorder, TechniqueConfig as _, wgpu};
use antumbra_measure::{Shot, Stage};
use antumbra_reference::{SampleClass, TruthOptions, ViewSample};
use antumbra_sampling::view_samples::{Grid, twin};
use antumbra_sampling::{ViewSampleMap, ViewSampleMapping};
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Camera, Light, LightKind, Mesh, Scene};
use antumbra_tests::gpu;
use antumbra_volume::Triangle;
use glam::{DAffine3, DVec3, Vec3};

const LIGHTS: [LightKind; 3] = [LightKind::Directional, LightKind::Spot, LightKind::Point];
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

fn shoot(gpu: &Gpu, stage: &Stage, light: &Light, buckets: u32) -> Shot {
    let mut technique = ViewSampleMapping { buckets }.build(gpu).expect("a valid config");
    stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot")
}

/// What the oracle says: each triangle's volume asked.
fn asked(gpu: &Gpu, stage: &Stage, light: &Light) -> Vec<f32> {
    let mut technique = Triangle::default().build(gpu).expect("built");
    stage.shoot(gpu, light, technique.as_mut(), 0).expect("a shot").visibility
}

/// Of the samples that count, how many there are, how many are dark, and how many wrong.
#[derive(Clone, Copy, Debug)]
struct Score {
    counted: usize,
    dark: usize,
    wrong: usize,
}

fn score(stage: &Stage, light: &Light, visibility: &[f32]) -> Score {
    let truth = stage.truth(light, &TIES);
    let counted: Vec<usize> =
        (0..visibility.len()).filter(|&i| truth.class[i] == SampleClass::Counted).collect();
    let dark = counted.iter().filter(|&&i| truth.visibility[i] == 0.0).count();
    let wrong = counted.iter().filter(|&&i| truth.visibility[i] != visibility[i]).count();
    Score { counted: counted.len(), dark, wrong }
}

#[test]
fn no_sample_is_wrong_on_any_generated_scene() {
    let gpu = gpu();
    let mut faults = Vec::new();
    let mut dark = 0;
    for (name, build, _) in generate::ALL {
        let scene = build();
        let stage = stage(&gpu, &scene, 128);
        for kind in LIGHTS {
            let light = scene.light_or_placed(kind);
            let score = score(&stage, &light, &shoot(&gpu, &stage, &light, 256).visibility);
            assert!(score.counted > 1000, "{name}, {kind:?}: {score:?}");
            dark += score.dark;
            if score.wrong > 0 {
                faults.push(format!("{name}, {kind:?}: {score:?}"));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(dark > 50_000, "{dark} samples in shadow");
}

#[test]
fn a_light_a_thousandth_of_the_scene_aside_is_found_out() {
    let gpu = gpu();
    let scene = generate::by_name("cube").expect("a scene");
    let stage = stage(&gpu, &scene, 128);
    let light = scene.light_or_placed(LightKind::Point);
    let aside = light.translated(DVec3::X * 0.001 * scene.bounds().radius());
    let score = score(&stage, &light, &shoot(&gpu, &stage, &aside, 256).visibility);
    assert!(score.wrong > 0, "{score:?}");
}

#[test]
fn the_grid_changes_nothing() {
    let gpu = gpu();
    let mut most_pieces = 0;
    for name in ["cube", "fence", "tree", "hall"] {
        let scene = generate::by_name(name).expect("a scene");
        let stage = stage(&gpu, &scene, 64);
        for kind in LIGHTS {
            let light = scene.light_or_placed(kind);
            let asked = asked(&gpu, &stage, &light);
            assert!(asked.contains(&0.0) && asked.contains(&1.0), "{name}, {kind:?}: no shadow");
            for buckets in [1, 3, 32, 256, 1024] {
                let shot = shoot(&gpu, &stage, &light, buckets);
                let off = shot.visibility.iter().zip(&asked).filter(|(a, b)| a != b).count();
                assert_eq!(off, 0, "{name}, {kind:?}, {buckets} buckets a side");
                most_pieces = most_pieces.max(shot.counters["pieces"]);
            }
        }
    }
    // So the pieces for which there is no room have been tried too.
    assert!(most_pieces >= 1 << 18, "at most {most_pieces} pieces");
}

/// What a triangle's rows hold is what its f64 twin says, to a thousandth of a bucket.
#[test]
fn triangles_are_handed_the_samples_under_them_and_no_others() {
    let gpu = gpu();
    for name in ["cube", "sphere", "street", "hall"] {
        let scene = generate::by_name(name).expect("a scene");
        let mut stage = stage(&gpu, &scene, 128);
        // All triangles are casters.
        stage.meshes.set_culling(false);
        for kind in LIGHTS {
            let light = scene.light_or_placed(kind);
            let mut technique =
                ViewSampleMap::new(&gpu, &ViewSampleMapping::default()).expect("a valid config");
            let shot = stage.shoot(&gpu, &light, &mut technique, 0).expect("a shot");
            let grid = technique.grid().expect("a prepared frame");
            // f32 places samples to within 2^-21 of 100 m, and a bucket is 1 cm at least: 5e-3 of a bucket. What is
            // added for rounding is to cost no more than a twentieth of one.
            let [least, most] = [-5e-3, 5e-2].map(|slack| tests_of(&stage, grid, slack));
            let found = shot.counters["tests"];
            assert!(least > 100, "{name}, {kind:?}: {least} tests");
            assert!((least..=most).contains(&found), "{name}, {kind:?}: {least} {found} {most}");
            assert!(most - least < least / 5, "{name}, {kind:?}: {least} to {most} say nothing");
        }
    }
}

/// How many samples all triangles together are to be tested against, covering buckets with `slack`.
fn tests_of(stage: &Stage, grid: &Grid, slack: f64) -> u64 {
    let side = grid.side as usize;
    let light = grid.light;
    let mut sums = vec![vec![0_u64; side * side + 1]; grid.faces.len()];
    for (p, n) in stage.image.positions.iter().zip(&stage.image.normals) {
        let (p, n) = (p.as_dvec3(), n.as_dvec3());
        if n == DVec3::ZERO || n.dot(light.truncate() - p * light.w) <= 0.0 {
            continue;
        }
        let d = p - light.truncate() * light.w;
        let axis = d.abs().max_position();
        let index = if grid.faces.len() == 1 { 0 } else { 2 * axis + usize::from(d[axis] < 0.0) };
        let Some([s, t]) = grid.faces[index].and_then(|face| face.place(d)) else { continue };
        let size = grid.side as f64;
        if s < -1.0 || t < -1.0 || s > size + 1.0 || t > size + 1.0 {
            continue;
        }
        let [s, t] = [s, t].map(|x| x.floor().clamp(0.0, size - 1.0) as usize);
        sums[index][t * side + s + 1] += 1;
    }
    for sums in &mut sums {
        for i in 1..sums.len() {
            sums[i] += sums[i - 1];
        }
    }
    let mut tests = 0;
    for triangle in &stage.triangles.triangles {
        let corners = triangle.map(|i| stage.triangles.positions[i as usize].as_dvec3());
        for (face, sums) in grid.faces.iter().zip(&sums) {
            let Some(face) = face else { continue };
            for run in twin::cover(face, grid.side, light, corners, slack) {
                let row = run.row as usize * side;
                tests += sums[row + run.last as usize + 1] - sums[row + run.first as usize];
            }
        }
    }
    tests
}

/// A wall along the light: all of its samples lie in a column of the grid or two.
#[test]
fn samples_that_pile_up_are_shared_out_in_pieces() {
    let gpu = gpu();
    // A wall 4 m high and 8 m long, under a plate whose edge throws a shadow half down it.
    let mut scene = Scene::default();
    scene.add(
        shapes::quad(DVec3::new(0.0, 2.0, 0.0), DVec3::Z * 4.0, DVec3::Y * 2.0),
        DAffine3::IDENTITY,
    );
    scene.add(shapes::icosphere(3, 0.5), DAffine3::from_translation(DVec3::new(-0.3, 5.0, 0.0)));
    for slant in [1e-2_f64, 1e-4, 1e-6] {
        // Light that grazes the side that looks to -x.
        let light = Light::Directional {
            direction: DVec3::new(slant, -1.0, 0.0).normalize(),
            angular_diameter: 0.0,
        };
        let points: Vec<ViewSample> = (0..1 << 15)
            .map(|i| {
                let (a, b) = (f64::from(i % 181) / 181.0, f64::from(i / 181) / 182.0);
                let p = DVec3::new(0.0, 4.0 * b, 8.0 * a - 4.0) - scene.origin();
                ViewSample { position: p.as_vec3(), normal: Vec3::NEG_X }
            })
            .collect();
        let stage = Stage::at_points(&gpu, &scene, &points).expect("a stage");
        let asked = asked(&gpu, &stage, &light);
        for buckets in [1, 16, 256] {
            let shot = shoot(&gpu, &stage, &light, buckets);
            assert!(shot.visibility == asked, "{slant}, {buckets} buckets a side");
            let score = score(&stage, &light, &shot.visibility);
            assert_eq!(score.wrong, 0, "{slant}, {buckets}: {score:?}");
            // A piece is at most 128 samples, however long the list; and none is there without samples.
            let (tests, pieces) = (shot.counters["tests"], shot.counters["pieces"]);
            assert!(tests <= 128 * pieces && pieces <= tests, "{:?}", shot.counters);
            let occupied = shot.counters["buckets_occupied"];
            // 4 m of wall are 0.4 mm wide at a slant of 1e-4, and a bucket 4 mm.
            let columns = if slant > 1e-3 { 256 } else { 2 };
            let most = columns * u64::from(buckets);
            assert!(occupied <= most, "{slant}, {buckets}: {occupied} buckets");
        }
    }
}

#[test]
fn a_fan_of_triangles_leaves_no_crack() {
    let gpu = gpu();
    let mut scene = Scene::default();
    scene.add(shapes::floor(4.0), DAffine3::IDENTITY);
    let mut positions = vec![Vec3::ZERO];
    positions.extend((0..64).map(|i| {
        let (sin, cos) = (f32::from(i as u8) * std::f32::consts::PI / 32.0).sin_cos();
        Vec3::new(2.0 * cos, 0.0, 2.0 * sin)
    }));
    let triangles = (0..64).map(|i| [0, 1 + i, 1 + (i + 1) % 64]).collect();
    let fan = Mesh { name: "fan".to_owned(), positions, triangles };
    scene.add(fan, DAffine3::from_translation(DVec3::Y));
    for degrees in 0..12 {
        let angle = f64::from(degrees).to_radians();
        let direction = DVec3::new(0.3 * angle.cos(), -1.0, 0.3 * angle.sin());
        let light = Light::Directional { direction: direction.normalize(), angular_diameter: 0.0 };
        // Along the shadows of the edges and of the centre, where a sample is on two or all of them at once.
        let centre = DVec3::Y + direction;
        let points: Vec<ViewSample> = (0..64 * 32)
            .map(|i| {
                let turn = f64::from(i / 32) * std::f64::consts::PI / 32.0;
                let out =
                    DVec3::new(turn.cos(), 0.0, turn.sin()) * (1.9 * f64::from(i % 32) / 32.0);
                ViewSample { position: (centre + out - scene.origin()).as_vec3(), normal: Vec3::Y }
            })
            .collect();
        let stage = Stage::at_points(&gpu, &scene, &points).expect("a stage");
        for buckets in [8, 256] {
            let found = shoot(&gpu, &stage, &light, buckets).visibility;
            let lit = found[..points.len()].iter().filter(|v| **v != 0.0).count();
            assert_eq!(lit, 0, "{degrees} degrees, {buckets}: light through {lit} cracks");
        }
    }
}

/// Triangles that are none, twice there, edge-on, about the light, or across its plane.
fn odd_triangles(light: DVec3) -> Scene {
    let mut scene = Scene::default();
    scene.add(shapes::floor(6.0), DAffine3::IDENTITY);
    let p = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    let at = light.as_vec3();
    let positions = vec![
        // A point, a line, the same triangle twice and once the other way.
        p(0.0, 1.0, 0.0),
        p(1.0, 1.0, 0.0),
        p(2.0, 1.0, 0.0),
        p(1.0, 1.5, 1.0),
        // Edge-on under a sun overhead, and in the plane of the lamp.
        p(-1.0, 0.5, -1.0),
        p(-1.0, 2.0, -1.0),
        at,
        // From below the lamp to far above it.
        p(-2.0, 0.5, 1.0),
        p(-3.0, 9.0, 1.0),
        p(-2.0, 0.7, 2.0),
        // Beyond everything in view.
        p(-500.0, 1.0, -9.0),
        p(500.0, 1.0, -9.0),
        p(0.0, 800.0, -500.0),
    ];
    let triangles = vec![
        [0, 0, 0],
        [0, 1, 2],
        [0, 2, 3],
        [0, 2, 3],
        [0, 3, 2],
        [4, 5, 6],
        [0, 3, 6],
        [7, 8, 9],
        [10, 11, 12],
    ];
    let mesh = Mesh { name: "odd".to_owned(), positions, triangles };
    scene.add(mesh, DAffine3::IDENTITY);
    scene
}

#[test]
fn odd_triangles_in_any_order_are_as_the_truth_has_them() {
    let gpu = gpu();
    let lamp = DVec3::new(0.5, 4.0, 0.25);
    let mut scene = odd_triangles(lamp);
    let lights = [
        Light::Point { position: lamp },
        Light::Spot { position: lamp, direction: DVec3::NEG_Y, outer_angle: 1.2 },
        Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 },
        Light::sun(0.5, 2.0, 0.0),
    ];
    let points: Vec<ViewSample> = (0..1 << 14)
        .map(|i| {
            let (x, z) = (f64::from(i % 128) / 128.0, f64::from(i / 128) / 128.0);
            let p = DVec3::new(12.0 * x - 6.0, 0.0, 12.0 * z - 6.0) - scene.origin();
            ViewSample { position: p.as_vec3(), normal: Vec3::Y }
        })
        .collect();
    let mut before: Vec<Vec<f32>> = Vec::new();
    for turn in 0..2 {
        let stage = Stage::at_points(&gpu, &scene, &points).expect("a stage");
        for (i, light) in lights.iter().enumerate() {
            for buckets in [1, 64] {
                let found = shoot(&gpu, &stage, light, buckets).visibility;
                let score = score(&stage, light, &found);
                assert_eq!(score.wrong, 0, "{light:?}, {buckets}: {score:?}");
                assert!(score.dark > 20, "{light:?}, {buckets}: {score:?}");
                if turn == 0 {
                    before.push(found);
                } else {
                    let index = 2 * i + usize::from(buckets == 64);
                    assert!(found == before[index], "{light:?}, {buckets}: order matters");
                }
            }
        }
        scene.meshes.iter_mut().for_each(|mesh| mesh.triangles.reverse());
    }
}

#[test]
fn one_technique_serves_frame_after_frame() {
    let gpu = gpu();
    let mut technique = ViewSampleMapping::default().build(&gpu).expect("a valid config");
    // Views and casters that grow and shrink, lights of all kinds, and none to cast.
    for (name, side) in
        [("cube", 64), ("street", 96), ("grazing-plane", 32), ("cube", 96), ("street", 64)]
    {
        let scene = generate::by_name(name).expect("a scene");
        let stage = stage(&gpu, &scene, side);
        for kind in LIGHTS {
            let light = scene.light_or_placed(kind);
            let found = stage.shoot(&gpu, &light, technique.as_mut(), 1).expect("a shot");
            let fresh = shoot(&gpu, &stage, &light, 256);
            assert!(found.visibility == fresh.visibility, "{name}, {side}, {kind:?}");
            assert_eq!(found.counters, fresh.counters, "{name}, {side}, {kind:?}");
        }
    }
    assert_eq!(gpu.check(), Ok(()), "no error from wgpu");
}

#[test]
fn a_sample_that_is_no_number_disturbs_no_other() {
    let gpu = gpu();
    let scene = generate::by_name("cube").expect("a scene");
    let seen = stage(&gpu, &scene, 64);
    let light = scene.light_or_placed(LightKind::Point);
    let mut points = seen.view_samples();
    let before = Stage::at_points(&gpu, &scene, &points).expect("a stage");
    let before = shoot(&gpu, &before, &light, 64).visibility;
    assert!(before.contains(&0.0), "no shadow");
    for (i, x) in [(100, f32::NAN), (2000, f32::INFINITY), (3000, 1e30)] {
        points[i] = ViewSample { position: Vec3::new(x, 0.0, 0.0), normal: Vec3::Y };
    }
    let after = Stage::at_points(&gpu, &scene, &points).expect("a stage");
    let after = shoot(&gpu, &after, &light, 64).visibility;
    let changed = (0..before.len()).filter(|i| before[*i] != after[*i]);
    assert!(changed.clone().all(|i| [100, 2000, 3000].contains(&i)), "{}", changed.count());
}

/// Rods of needles, whose planes are hard to tell, aslant over a floor.
#[test]
fn needles_do_not_shadow_themselves() {
    let gpu = gpu();
    let mut scene = Scene::default();
    scene.add(shapes::floor(3.0), DAffine3::IDENTITY);
    for i in 0..8 {
        let x = 0.02 * f64::from(i);
        let (from, to) = (DVec3::new(x, 0.05, 0.1), DVec3::new(0.2 + x, 0.3, -0.21));
        scene.add(shapes::frustum(from, to, 4e-3, 4e-3, 48), DAffine3::IDENTITY);
    }
    let camera = Camera {
        eye: DVec3::new(0.5, 0.4, 0.4),
        target: DVec3::new(0.17, 0.17, -0.05),
        up: DVec3::Y,
        fov_y: 0.6,
        near: 0.01,
    };
    let stage = Stage::new(&gpu, &scene, camera, 128, 128).expect("a stage");
    for kind in LIGHTS {
        let light = scene.place_light(kind);
        let score = score(&stage, &light, &shoot(&gpu, &stage, &light, 256).visibility);
        assert!(score.wrong == 0 && score.dark > 200, "{kind:?}: {score:?}");
    }
}

/// The rasteriser snaps corners, and draws pixels whose centres lie beyond the triangle.
#[test]
fn samples_lie_on_their_triangles() {
    let gpu = gpu();
    for name in ["cube", "non-manifold", "thin-wall"] {
        let scene = generate::by_name(name).expect("a scene");
        let stage = stage(&gpu, &scene, 256);
        let corners: Vec<[DVec3; 3]> = stage
            .triangles
            .triangles
            .iter()
            .map(|t| t.map(|i| stage.triangles.positions[i as usize].as_dvec3()))
            .collect();
        for (p, n) in stage.image.positions.iter().zip(&stage.image.normals) {
            if *n == Vec3::ZERO {
                continue;
            }
            let p = p.as_dvec3();
            // Eight roundings of coordinates up to 20 m.
            let off = 20.0 * 2f64.powi(-20);
            assert!(corners.iter().any(|t| is_on(*t, p, off)), "{name}: {p} is on no triangle");
        }
    }
}

/// Whether `p` lies within `off` of a triangle's plane and of its inside.
fn is_on([a, b, c]: [DVec3; 3], p: DVec3, off: f64) -> bool {
    let n = (b - a).cross(c - a).normalize();
    let inner = |a: DVec3, b: DVec3| n.cross((b - a).normalize()).dot(p - a) >= -off;
    n.dot(p - a).abs() <= off && inner(a, b) && inner(b, c) && inner(c, a)
}

/// Casters that keep their triangles to themselves.
struct Reticent<'a>(&'a dyn Casters);

impl Casters for Reticent<'_> {
    fn hull(&self, light: &Light, visit: &mut dyn FnMut(DVec3)) {
        self.0.hull(light, visit);
    }

    fn draw(&self, view: &LightView<'_>, pass: &mut wgpu::RenderPass<'_>) -> Drawn {
        self.0.draw(view, pass)
    }
}

#[test]
fn what_cannot_be_served_is_refused_with_a_fix() {
    let gpu = gpu();
    for buckets in [0, 1025, u32::MAX] {
        let error = ViewSampleMapping { buckets }.build(&gpu).err().map(|e| e.to_string());
        assert!(error.is_some_and(|e| e.contains("use 1 to 1024")), "{buckets} passed");
    }
    let scene = generate::by_name("cube").expect("a scene");
    let stage = stage(&gpu, &scene, 16);
    let light = scene.light_or_placed(LightKind::Point);
    let mut technique = ViewSampleMapping::default().build(&gpu).expect("a valid config");
    let reticent = Reticent(&stage.meshes);
    let frame = Frame { casters: &reticent, ..stage.frame(&light) };
    let error = technique.prepare(&gpu, &frame).err().map(|e| e.to_string());
    assert!(error.is_some_and(|e| e.contains("map/plain")), "no fix");
    let bad = Light::Point { position: DVec3::NAN };
    assert!(technique.prepare(&gpu, &stage.frame(&bad)).is_err(), "a light that is nowhere");
    let frame = stage.frame(&light);
    let target = stage.samples.visibility_target(&gpu).expect("a target");
    let view = target.create_view(&Default::default());
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut recorder = Recorder::new(&mut encoder);
    let error = technique.encode(&gpu, &frame, &mut recorder, &view).err().map(|e| e.to_string());
    assert!(error.is_some_and(|e| e.contains("call `prepare`")), "encoded unprepared");
}
