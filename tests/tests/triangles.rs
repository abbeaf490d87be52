//! The maps that hold triangles: identity in place of depth, and the triangle in place of the texel.

use antumbra::Config;
use antumbra_gpu::read_f32_texture;
use antumbra_gpu::{Frame, Gpu, Recorder, Technique, ViewSamples};
use antumbra_map::{ObjectId, Plain, PolygonId, TriangleDepth};
use antumbra_measure::Stage;
use antumbra_reference::{SampleClass, TruthOptions, ViewSample};
use antumbra_scene::generate::shapes;
use antumbra_scene::{Light, LightKind, Mesh, Scene};
use antumbra_tests::gpu;
use glam::{DAffine3, DVec3, Vec3};

use crate::shared::reticent::Reticent;
use crate::shared::traced;

use traced::{Model, by_object, by_triangles, count, receivers};

/// Side of a view, samples.
const VIEW: u32 = 224;

fn stage(gpu: &Gpu, scene: &Scene) -> Stage {
    Stage::new(gpu, scene, scene.camera_or_framing(), VIEW, VIEW).expect("a stage")
}

fn run(gpu: &Gpu, frame: &Frame<'_>, technique: &mut dyn Technique) -> Vec<f32> {
    let target = frame.samples.visibility_target(gpu).expect("a target");
    technique.prepare(gpu, frame).expect("prepared");
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let view = target.create_view(&Default::default());
    technique.encode(gpu, frame, &mut Recorder::new(&mut encoder), &view).expect("encoded");
    gpu.queue.submit([encoder.finish()]);
    read_f32_texture(gpu, &target, 0).expect("read back")
}

fn visibility(gpu: &Gpu, stage: &Stage, light: &Light, config: &Config, size: u32) -> Vec<f32> {
    let mut config = config.clone();
    config.set_map_size(size);
    let mut technique = config.build(gpu).expect("a valid config");
    run(gpu, &stage.frame(light), technique.as_mut())
}

/// Boxes and a tetrahedron over a floor, none of whose triangles is small: creases, contacts, shadows on slopes.
fn large_triangles() -> Scene {
    let mut scene = Scene::default();
    scene.add(shapes::floor(4.0), DAffine3::IDENTITY);
    let half = DVec3::new(0.5, 0.4, 0.7);
    let turned = DAffine3::from_rotation_y(0.4);
    scene.add(shapes::cuboid(half.with_y(0.0) - half.with_y(0.0) * 2.0, half.with_y(0.8)), turned);
    let placed = |at: DVec3| DAffine3::from_translation(at) * DAffine3::from_rotation_x(0.5);
    scene.add(shapes::tetrahedron(0.7), placed(DVec3::new(-1.3, 1.1, 0.4)));
    scene.add(shapes::cuboid(-half, half), placed(DVec3::new(0.9, 1.6, -0.8)));
    scene
}

/// The number of samples that face the light and are no ties, and those that are lit though the truth is dark, and dark
/// though it is lit.
fn wrong(stage: &Stage, light: &Light, found: &[f32]) -> (usize, [Vec<usize>; 2]) {
    let options = TruthOptions { ties: true, tie_distance: 1e-4, ..TruthOptions::default() };
    let truth = stage.truth(light, &options);
    let counted = |i: &usize| truth.class[*i] == SampleClass::Counted;
    let judged: Vec<usize> = (0..found.len()).filter(counted).collect();
    let off = |sign: f32| {
        let is_off = |i: &usize| sign * (found[*i] - truth.visibility[*i]) > 0.0;
        judged.iter().copied().filter(is_off).collect()
    };
    (judged.len(), [off(1.0), off(-1.0)])
}

#[test]
fn triangles_larger_than_texels_give_the_exact_shadow() {
    let gpu = gpu();
    let scene = large_triangles();
    let stage = stage(&gpu, &scene);
    let receivers = receivers(&gpu, &stage);
    for kind in [LightKind::Directional, LightKind::Spot, LightKind::Point] {
        let light = match kind {
            LightKind::Directional => Light::sun(0.6, 0.9, 0.0),
            _ => scene.place_light(kind),
        };
        // Texels of some 2 cm, sides of 0.7 m and more.
        let exact = Config::TriangleDepth(TriangleDepth { reach: 2, ..Default::default() });
        let found = visibility(&gpu, &stage, &light, &exact, 256);
        let (judged, [leaks, dark]) = wrong(&stage, &light, &found);
        assert!(judged > 4000, "{kind:?}: {judged} samples");
        assert!(dark.is_empty(), "{kind:?}: {dark:?} are in false shadow");
        // At a triangle's sharp tip no texel nearby need show it: then none does for certain.
        let mut model = Model::new(&gpu, &stage, &light, 256, 2);
        let shown = |i: &usize| {
            let r = &receivers[*i];
            let at = model.lookup(r, 2);
            at.is_some_and(|at| by_triangles(&model, r, &at) == Some(true))
        };
        let missed = leaks.len();
        let shown: Vec<usize> = leaks.into_iter().filter(shown).collect();
        assert!(shown.is_empty(), "{kind:?}: {shown:?} are lit behind what their texels show");
        // The control: a map of texels, and coarse ones.
        let texels = Config::Plain(Plain::default());
        let coarse = visibility(&gpu, &stage, &light, &texels, 32);
        let (_, off) = wrong(&stage, &light, &coarse);
        let off: usize = off.iter().map(Vec::len).sum();
        assert!(
            off > 10 * missed + 20,
            "{kind:?}: the plain map is wrong in {off}, {missed} missed"
        );
    }
}

/// A lone level square of `count` x `count` quads.
fn grid(count: u32) -> Scene {
    let at = |i: u32| 2.0 * f64::from(i) / f64::from(count) - 1.0;
    let positions = (0..=count)
        .flat_map(|j| (0..=count).map(move |i| DVec3::new(at(i), 0.0, at(j)).as_vec3()))
        .collect();
    let corner = |i: u32, j: u32| j * (count + 1) + i;
    let triangles = (0..count).flat_map(|j| {
        (0..count).flat_map(move |i| {
            let (a, b, c, d) =
                (corner(i, j), corner(i + 1, j), corner(i, j + 1), corner(i + 1, j + 1));
            [[a, c, b], [b, c, d]]
        })
    });
    let triangles = triangles.collect();
    let mut scene = Scene::default();
    let mesh = Mesh { name: "grid".to_owned(), positions, triangles };
    // Turned, so that no triangle's edge runs along texels or through their corners.
    scene.add(mesh, DAffine3::from_rotation_x(0.2) * DAffine3::from_rotation_y(0.3));
    scene
}

#[test]
fn polygons_shadow_their_neighbours_the_more_the_smaller_they_are() {
    let gpu = gpu();
    let light = Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 };
    let false_shadow = |count: u32, config: &Config| {
        let scene = grid(count);
        let mut stage = stage(&gpu, &scene);
        stage.meshes.set_culling(false);
        let found = visibility(&gpu, &stage, &light, config, 64);
        let there = stage.image.normals.iter().filter(|n| **n != Vec3::ZERO).count();
        found.iter().filter(|v| **v == 0.0).count() as f64 / there as f64
    };
    let rates = |config: &Config| [1, 4, 16, 64, 128].map(|count| false_shadow(count, config));
    let alone = rates(&Config::PolygonId(PolygonId::default()));
    assert!(alone.is_sorted(), "{alone:?}");
    // Two triangles meet along one line of texels; of 8 triangles a texel at least, one is lit.
    assert!(alone[0] > 0.0 && alone[0] < 0.02, "{alone:?}");
    assert!(alone[4] >= 0.86, "{alone:?}");
    // A neighbourhood mends edges, though not tips, while triangles are larger than it; an object is one whatever
    // its triangles.
    let near = rates(&Config::PolygonId(PolygonId { reach: 1, ..Default::default() }));
    assert!((0..3).all(|i| 4.0 * near[i] < alone[i]), "{near:?}, {alone:?}");
    let object = rates(&Config::ObjectId(ObjectId::default()));
    assert!(object.iter().all(|rate| *rate == 0.0), "{object:?}");
}

/// A wall and a slab in its shadow, as one instance or as two.
fn corner(in_one: bool) -> Scene {
    let wall = shapes::cuboid(DVec3::new(0.0, 0.0, -1.0), DVec3::new(0.2, 1.5, 1.0));
    let slab = shapes::cuboid(DVec3::new(0.2, 0.0, -1.0), DVec3::new(1.5, 0.2, 1.0));
    let mut scene = Scene::default();
    if in_one {
        let mut both = wall;
        let first = both.positions.len() as u32;
        both.positions.extend(&slab.positions);
        both.triangles.extend(slab.triangles.iter().map(|t| t.map(|i| i + first)));
        scene.add(both, DAffine3::IDENTITY);
    } else {
        scene.add(wall, DAffine3::IDENTITY);
        scene.add(slab, DAffine3::IDENTITY);
    }
    scene
}

#[test]
fn an_object_shadows_others_but_never_itself() {
    let gpu = gpu();
    // No side is edge-on to it.
    let light = Light::sun(0.8, -1.2, 0.0);
    let object = Config::ObjectId(ObjectId::default());
    for in_one in [true, false] {
        let stage = stage(&gpu, &corner(in_one));
        let found = visibility(&gpu, &stage, &light, &object, 512);
        let truth = stage.truth(&light, &TruthOptions::default());
        let dark = |v: &[f32]| {
            let counted = (0..v.len()).filter(|&i| truth.class[i] == SampleClass::Counted);
            counted.filter(|&i| v[i] == 0.0).count()
        };
        let expected = dark(&truth.visibility);
        assert!(expected > 500, "the wall shadows {expected} samples of the slab");
        if in_one {
            assert_eq!(dark(&found), 0, "an object shadows itself");
        } else {
            let mut model = Model::new(&gpu, &stage, &light, 512, 0);
            let right = count(&mut model, &receivers(&gpu, &stage), &found, (0, by_object));
            assert_eq!(right.wrong, 0, "{right:?}");
            assert!(2 * right.dark > expected && 20 * right.open < right.lit, "{right:?}");
        }
    }
}

#[test]
fn samples_that_do_not_know_their_object_know_their_triangle() {
    let gpu = gpu();
    let scene = large_triangles();
    let stage = stage(&gpu, &scene);
    let light = scene.place_light(LightKind::Directional);
    let unknown = ViewSamples::new(&gpu, VIEW, VIEW).expect("a valid size");
    unknown.write(&gpu, &stage.image.positions, &stage.image.normals).expect("lists that fit");
    let frame = Frame { samples: &unknown, ..stage.frame(&light) };
    let mut answers = [
        Config::ObjectId(ObjectId { size: 256 }),
        Config::PolygonId(PolygonId { size: 256, reach: 0 }),
    ]
    .map(|config| {
        let mut technique = config.build(&gpu).expect("a valid config");
        (run(&gpu, &frame, technique.as_mut()), run(&gpu, &stage.frame(&light), technique.as_mut()))
    });
    let (polygon, object) = (answers[1].clone(), &mut answers[0]);
    assert!(object.0 == polygon.0, "without objects, identity is the triangle's");
    assert!(polygon.0 == polygon.1, "polygons need no object");
    assert!(object.1 != polygon.1, "with objects, identity is the object's");
}

#[test]
fn points_given_to_a_stage_know_their_object() {
    // On the floor at the foot of a box, where the boxes of both hold the point.
    let gpu = gpu();
    let mut scene = Scene::default();
    scene.add(shapes::floor(3.0), DAffine3::IDENTITY);
    scene.add(
        shapes::cuboid(DVec3::new(-0.5, 0.0, -0.5), DVec3::new(0.5, 1.0, 0.5)),
        DAffine3::IDENTITY,
    );
    let origin = scene.origin();
    let point = |x: f64, y: f64, n: Vec3| ViewSample {
        position: (DVec3::new(x, y, 0.1) - origin).as_vec3(),
        normal: n,
    };
    let points = [
        point(2.0, 0.0, Vec3::Y),
        point(0.1, 1.0, Vec3::Y),
        point(0.5, 0.5, Vec3::X),
        point(2.0, 2.0, Vec3::Y),
    ];
    let stage = Stage::at_points(&gpu, &scene, &points).expect("a stage");
    let read = read_f32_texture(&gpu, &stage.samples.positions, 0).expect("read back");
    let objects: Vec<f32> = read.chunks_exact(4).take(points.len() + 1).map(|p| p[3]).collect();
    // Floor, box, box, nothing known, no sample.
    assert_eq!(objects, [2.0, 3.0, 3.0, 1.0, 0.0], "numbers of objects");
}

#[test]
fn a_reach_out_of_range_and_casters_without_triangles_are_refused_with_a_fix() {
    let gpu = gpu();
    for config in [
        Config::PolygonId(PolygonId { reach: 9, ..Default::default() }),
        Config::TriangleDepth(TriangleDepth { reach: 9, ..Default::default() }),
    ] {
        let error = config.build(&gpu).err().map(|e| e.to_string());
        assert!(error.is_some_and(|e| e.contains("use 0 to 8")), "{config:?} passed");
    }
    let scene = large_triangles();
    let stage = stage(&gpu, &scene);
    let light = scene.place_light(LightKind::Point);
    let reticent = Reticent(&stage.meshes);
    let frame = Frame { casters: &reticent, ..stage.frame(&light) };
    for config in [
        Config::PolygonId(PolygonId::default()),
        Config::ObjectId(ObjectId::default()),
        Config::TriangleDepth(TriangleDepth::default()),
    ] {
        let mut technique = config.build(&gpu).expect("a valid config");
        let error = technique.prepare(&gpu, &frame).err().map(|e| e.to_string());
        assert!(error.is_some_and(|e| e.contains("map/plain")), "{config:?} says no fix");
    }
}
