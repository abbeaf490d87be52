//! Cameras, lights and the ground placed from a scene's bounds.

use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Bounds, Camera, Light, LightKind, Mesh, MeshError, Scene};
use glam::{DAffine3, DVec2, DVec3, DVec4, Vec3};

fn scene_of(mesh: Mesh, at: DVec3) -> Scene {
    let mut scene = Scene::default();
    scene.add(mesh, DAffine3::from_translation(at));
    scene
}

/// Scenes whose bounds are hard to place by.
fn scenes() -> Vec<(&'static str, Scene)> {
    let cube = || shapes::cuboid(-DVec3::ONE, DVec3::ONE);
    let mut point = shapes::floor(1.0);
    point.positions.fill(Vec3::ONE);
    vec![
        ("cube", scene_of(cube(), DVec3::ZERO)),
        ("thimble", scene_of(shapes::cylinder(0.005, 0.02, 12), DVec3::ONE)),
        ("flat", scene_of(shapes::floor(3.0), DVec3::ZERO)),
        ("upright", scene_of(shapes::quad(DVec3::ZERO, DVec3::X, DVec3::Y), DVec3::ZERO)),
        ("far", scene_of(cube(), DVec3::new(1e6, -1e6, 1e6))),
        ("a point far out", scene_of(point.clone(), DVec3::splat(1e6))),
        ("a point", scene_of(point, DVec3::NEG_ONE)),
        ("large", scene_of(shapes::icosphere(2, 1e6), DVec3::ZERO)),
        ("nothing", Scene::default()),
        ("street", generate::street()),
    ]
}

/// Centre and radius that placement goes by, a metre where there is no size.
fn sphere(scene: &Scene) -> (DVec3, f64) {
    let bounds = scene.subject_bounds();
    let center = if bounds.is_empty() { DVec3::ZERO } else { bounds.center() };
    (center, if bounds.radius() == 0.0 { 1.0 } else { bounds.radius() })
}

#[test]
fn the_framing_camera_shows_the_whole_sphere() {
    for (name, scene) in scenes() {
        let (center, radius) = sphere(&scene);
        let camera = scene.framing_camera();
        assert!(camera.eye.y > center.y + radius, "{name}: seen from above");
        let clip = camera.view_projection(center, 1.0);
        for i in 0..500 {
            let (y, turn) = (2.0 * (f64::from(i) + 0.5) / 500.0 - 1.0, 2.4 * f64::from(i));
            let ring = (1.0 - y * y).sqrt();
            let p = radius * DVec3::new(ring * turn.cos(), y, ring * turn.sin());
            let DVec4 { x, y, z, w } = clip * p.extend(1.0);
            assert!(x.abs() <= w && y.abs() <= w, "{name}: {p} is outside the picture");
            assert!(z > 0.0 && z < w, "{name}: {p} is cut by the near plane");
        }
    }
}

#[test]
fn placed_lights_shine_onto_the_scene_from_outside() {
    for (name, scene) in scenes() {
        let (center, radius) = sphere(&scene);
        for kind in LightKind::ALL {
            let light = scene.place_light(kind);
            assert_eq!(light.kind(), kind, "{name}: the kind asked for");
            assert_eq!(LightKind::by_name(kind.name()), Some(kind), "found by its name");
            let to_light = light.towards(center, DVec2::splat(0.5)).normalize();
            assert!(to_light.y > 0.4, "{name}: {kind:?} light from above: {to_light}");
            assert!(
                to_light.x.abs() > 0.1 && to_light.z.abs() > 0.1,
                "{name}: {kind:?} on an axis"
            );
            if let Some(position) = light.position() {
                let bounds = scene.subject_bounds();
                let outside = position.y > bounds.max.y || bounds.is_empty();
                let far = position.distance(center) > radius;
                assert!(outside || far, "{name}: {kind:?} light inside the scene");
            }
            let hard = matches!(kind, LightKind::Directional | LightKind::Point | LightKind::Spot);
            assert_eq!(light.is_hard(), hard, "{name}: {kind:?}");
        }
        let Light::Spot { position, direction, outer_angle } = scene.place_light(LightKind::Spot)
        else {
            panic!("asked for a spot");
        };
        assert!((direction.length() - 1.0).abs() < 1e-12, "{name}: no unit vector");
        let aim = (center - position).normalize();
        assert!(aim.dot(direction) > 1.0 - 1e-9, "{name}: not aimed at the centre");
        let needed = (radius / position.distance(center)).asin();
        assert!(outer_angle >= needed, "{name}: the cone leaves some of the sphere out");
        // The axes are orthonormal up to f64; the offset costs digits of the centre.
        let Light::Rect { center: middle, half_u, half_v } = scene.place_light(LightKind::Rect)
        else {
            panic!("asked for a rectangle");
        };
        assert!(half_u.dot(half_v).abs() < 1e-12 * radius * radius, "{name}: no right angle");
        let facing = half_u.cross(half_v).normalize().dot((center - middle).normalize()).abs();
        assert!(facing > 1.0 - 1e-9, "{name}: the rectangle does not face the scene");
        let Light::Disc { center: middle, axis_u, axis_v, .. } = scene.place_light(LightKind::Disc)
        else {
            panic!("asked for a disc");
        };
        let facing = axis_u.cross(axis_v).dot((center - middle).normalize()).abs();
        assert!(facing > 1.0 - 1e-9, "{name}: the disc does not face the scene");
    }
}

#[test]
fn a_ground_changes_neither_camera_nor_lights() {
    for (name, scene) in scenes() {
        let (center, radius) = sphere(&scene);
        let mut grounded = scene.clone();
        grounded.add_ground();
        assert_eq!(grounded.instances.len(), scene.instances.len() + 1, "{name}: one more");
        let ground = &grounded.instances[grounded.ground.expect("a ground was added")];
        let Bounds { min, max } = grounded.instance_bounds(ground);
        let lowest = if name == "nothing" { 0.0 } else { scene.bounds().min.y };
        assert_eq!((min.y, max.y), (lowest, lowest), "{name}: at the lowest point");
        let half = 0.5 * (max - min);
        // f32 vertices: half an ulp of 2^-24.
        assert!((half.x - 6.0 * radius).abs() < 1e-7 * 6.0 * radius, "{name}: {half}");
        assert!(
            (0.5 * (max + min) - center).with_y(0.0).length() < 1e-9 * (radius + center.length()),
            "{name}: under the centre"
        );
        if name == "nothing" {
            continue;
        }
        assert_eq!(grounded.framing_camera(), scene.framing_camera(), "{name}: the same camera");
        for kind in LightKind::ALL {
            assert_eq!(grounded.place_light(kind), scene.place_light(kind), "{name}: {kind:?}");
        }
        let once = grounded.clone();
        grounded.add_ground();
        assert_eq!(grounded, once, "{name}: a second ground is not added");
    }
}

#[test]
fn the_own_camera_and_light_win() {
    let scene = generate::by_name("cube").expect("a registered scene");
    assert_eq!(Some(scene.camera_or_framing()), scene.camera, "the scene's camera");
    assert_eq!(scene.light_or_placed(LightKind::Directional), scene.lights[0], "the scene's light");
    let placed = scene.place_light(LightKind::Disc);
    assert_eq!(scene.light_or_placed(LightKind::Disc), placed, "it has no disc");
}

#[test]
fn the_origin_is_finite_near_and_on_the_grid() {
    for (name, scene) in scenes() {
        let origin = scene.origin();
        assert!(origin.is_finite(), "{name}: {origin}");
        let all = scene.triangles(origin).expect("a valid scene");
        let (_, radius) = sphere(&scene);
        let reach = all.positions.iter().map(|p| p.as_dvec3().length()).fold(0.0, f64::max);
        assert!(reach <= 17.0 * radius.max(1e-5), "{name}: vertices {reach} m from the origin");
    }
    let cube = generate::by_name("convex-cube").expect("a registered scene");
    let relative = |offset: DVec3| {
        let moved = cube.translated(offset);
        moved.triangles(moved.origin()).expect("a valid scene").positions
    };
    let far = DVec3::new(1e5, 0.0, 1e5);
    assert_eq!(relative(far), relative(far + DVec3::new(4096.0, 64.0, -2048.0)), "on the grid");
}

#[test]
fn faults_of_hand_made_scenes_are_reported() {
    let mut scene = scene_of(shapes::floor(1.0), DVec3::ZERO);
    scene.instances[0].mesh = 3;
    assert!(scene.bounds().is_empty(), "no mesh, no bounds");
    assert_eq!(scene.triangle_count(), 0, "no mesh, no triangles");
    let error = scene.triangles(DVec3::ZERO).expect_err("mesh 3 of 1");
    assert!(matches!(error, MeshError::NoSuchMesh { mesh: 3, meshes: 1, .. }), "{error}");
    let scene = scene_of(shapes::floor(1.0), DVec3::splat(1e39));
    let error = scene.triangles(DVec3::ZERO).expect_err("no finite f32");
    assert!(matches!(error, MeshError::OutOfReach { vertex: 0, .. }), "{error}");
    assert!(scene.triangles(DVec3::splat(1e39)).is_ok(), "an origin near the scene helps");
}

#[test]
fn cameras_project_as_stated() {
    let camera = Camera {
        eye: DVec3::new(0.0, 1.0, 5.0),
        target: DVec3::new(0.0, 1.0, 0.0),
        up: DVec3::Y,
        fov_y: 1.0,
        near: 0.5,
    };
    let clip = camera.view_projection(DVec3::ZERO, 2.0);
    let ndc = |p: DVec3| clip.project_point3(p);
    assert!((ndc(DVec3::new(0.0, 1.0, 4.5)).z - 1.0).abs() < 1e-12, "1 at the near plane");
    assert!(ndc(DVec3::new(0.0, 1.0, -1e9)).z < 1e-8, "0 at infinity");
    for (x, y) in [(0.0, 0.0), (0.25, 0.75), (1.0, 0.5)] {
        let p = ndc(camera.eye + 7.0 * camera.ray_direction(x, y, 2.0));
        assert!((p.x - (2.0 * x - 1.0)).abs() < 1e-12, "({x}, {y}) shows at x = {}", p.x);
        assert!((p.y - (1.0 - 2.0 * y)).abs() < 1e-12, "({x}, {y}) shows at y = {}", p.y);
    }
    let down = Camera { target: DVec3::new(0.0, -1.0, 5.0), ..camera };
    assert!(down.view().is_finite(), "up along the view axis is replaced");
}

#[test]
fn samples_of_lights_lie_on_their_shapes() {
    let p = DVec3::new(0.3, -0.2, 0.9);
    let scene = scene_of(shapes::cuboid(-DVec3::ONE, DVec3::ONE), DVec3::ZERO);
    let grid = |n: u32| {
        (0..n * n)
            .map(move |i| (DVec2::new(f64::from(i % n), f64::from(i / n)) + 0.5) / f64::from(n))
    };
    for kind in LightKind::ALL {
        let light = scene.place_light(kind);
        let mean = grid(64).map(|s| light.towards(p, s)).sum::<DVec3>() / 4096.0;
        let middle = light.towards(p, DVec2::splat(0.5));
        assert!(mean.distance(middle) < 1e-9 * middle.length(), "{kind:?}: centred samples");
    }
    let Light::Disc { radius, .. } = scene.place_light(LightKind::Disc) else {
        panic!("asked for a disc");
    };
    let disc = scene.place_light(LightKind::Disc);
    let middle = disc.towards(p, DVec2::splat(0.5));
    let inner = grid(256).filter(|s| disc.towards(p, *s).distance(middle) < 0.5 * radius).count();
    // A quarter of the area; a 256-th of the square's side around the circle is uncertain.
    assert!((inner as f64 / 65536.0 - 0.25).abs() < 4.0 / 256.0, "uniform over the area: {inner}");
    let Light::Directional { direction, .. } = Light::sun(0.3, 1.1, 0.1) else {
        panic!("the sun is a directional light");
    };
    let sun = Light::sun(0.3, 1.1, 0.1);
    for s in grid(16) {
        let angle = sun.towards(p, s).angle_between(-direction);
        assert!(angle <= 0.05 + 1e-12, "a sample {angle} rad from the middle of the sun");
    }
}
