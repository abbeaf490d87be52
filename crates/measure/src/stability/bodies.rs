//! Cases of surfaces that are their own nearest caster: a sphere's limb, bodies that run into each other, and
//! triangles smaller than a texel.

use antumbra_gpu::{Gpu, Technique};
use antumbra_reference::{TruthOptions, ViewSample};
use antumbra_scene::generate::{self, SphereOverPlane, shapes};
use antumbra_scene::{Bounds, Light, Mesh, Scene};
use glam::{DAffine3, DVec2, DVec3, Vec3};

use super::unit_cube;
use crate::{MeasureError, Stage};

/// HC-08: how far from the limb, in texels, the farthest sample of a sphere's lit half lies that is not fully
/// lit; 0 where all are.
pub(super) fn limb(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    const SAMPLES_A_TRIANGLE: usize = 16;
    let numbers = SphereOverPlane::default();
    let scene = generate::sphere_over_plane(&numbers);
    let light = scene.lights[0];
    let triangles = scene.triangles(scene.origin())?;
    let to_light = light.towards(DVec3::ZERO, DVec2::splat(0.5));
    let mut points = Vec::new();
    for corners in &triangles.triangles {
        let [a, b, c] = corners.map(|i| triangles.positions[i as usize].as_dvec3());
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let on_sphere = a.y + triangles.origin.y > 0.0;
        // Of a face seen edge-on, the sign of the cosine is rounding's.
        if on_sphere && normal.dot(to_light) > 1e-4 {
            points.extend(unit_cube(SAMPLES_A_TRIANGLE).map(|[u, v, _]| {
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                let position = (a + (b - a) * u + (c - a) * v).as_vec3();
                ViewSample { position, normal: normal.as_vec3() }
            }));
        }
    }
    let stage = Stage::at_points(gpu, &scene, &points)?;
    let shot = stage.shoot(gpu, &light, technique, 0)?;
    let center = numbers.height * DVec3::Y - triangles.origin;
    let from_limb = |p: DVec3| numbers.radius - (p - center).reject_from(to_light).length();
    let wrong = points.iter().zip(&shot.visibility).filter(|(_, v)| **v != 1.0);
    let farthest = wrong.map(|(s, _)| from_limb(s.position.as_dvec3())).fold(0.0, f64::max);
    // The box around the sphere, seen from 60 degrees, is 1 m by cos 60 + sin 60 m.
    let (sin, cos) = 60_f64.to_radians().sin_cos();
    Ok(farthest / (2.0 * numbers.radius * (sin + cos) / f64::from(map_size)))
}

/// HC-09: share of wrong samples on two boxes that run into each other and on the floor around them, none of
/// them near a shadow's edge or a line along which two of them meet.
pub(super) fn interpenetrating(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    const SAMPLES_A_FACE: usize = 1 << 13;
    const NEAR: u32 = 32;
    let cubes = [
        Bounds { min: DVec3::ZERO, max: DVec3::ONE },
        Bounds { min: DVec3::new(0.5, 0.3, 0.4), max: DVec3::new(1.5, 1.3, 0.6) },
    ];
    let mut scene = Scene::default();
    scene.add(shapes::floor(6.0), DAffine3::IDENTITY);
    for cube in cubes {
        scene.add(shapes::cuboid(cube.min, cube.max), DAffine3::IDENTITY);
    }
    let elevation = 40_f64.to_radians();
    let light = Light::sun(elevation, -std::f64::consts::FRAC_PI_2, 0.0);
    // What the light meets: tops, sides towards -x, the floor. Corner, two sides and normal.
    let face = |b: Bounds, top: bool| match top {
        true => (b.min.with_y(b.max.y), (b.max - b.min).with_y(0.0), DVec3::Y),
        false => (b.min, (b.max - b.min).with_x(0.0), DVec3::NEG_X),
    };
    let floor = (DVec3::new(-1.0, 0.0, -1.0), DVec3::new(5.0, 0.0, 3.0), DVec3::Y);
    let mut faces = vec![floor];
    faces.extend(cubes.iter().flat_map(|b| [face(*b, true), face(*b, false)]));
    // The boxes from the light: 1.5 m of length and 1.3 m of height.
    let texel = (1.5 * elevation.sin() + 1.3 * elevation.cos()) / f64::from(map_size);
    // Twelve texels as the light sees them: beyond the reach of the widest kernel and its bias.
    let away = 12.0 * texel / elevation.sin();
    let origin = scene.origin();
    let inside = |p: DVec3| cubes.iter().any(|b| p.cmpgt(b.min).all() && p.cmplt(b.max).all());
    let sample =
        |p: DVec3, n: DVec3| ViewSample { position: (p - origin).as_vec3(), normal: n.as_vec3() };
    let (mut points, mut around) = (Vec::new(), Vec::new());
    for (corner, sides, n) in faces {
        let (u, v) = n.any_orthonormal_pair();
        for [a, b, _] in unit_cube(SAMPLES_A_FACE) {
            let p = corner
                + sides * if n == DVec3::Y { DVec3::new(a, 0.0, b) } else { DVec3::new(0.0, a, b) };
            // Eight directions and four distances, none of which a shadow of 0.2 m fits between.
            let near = |k: u32| {
                let (sin, cos) = (f64::from(k % 8) * std::f64::consts::FRAC_PI_4).sin_cos();
                p + (u * cos + v * sin) * (away * 0.25 * f64::from(1 + k / 8))
            };
            // Nobody sees a face within the other box, nor the floor under a box; what is near is at a contact.
            if inside(p + n * 1e-6) || (0..NEAR).any(|k| inside(near(k) + n * 1e-6)) {
                continue;
            }
            points.push(sample(p, n));
            around.extend((0..NEAR).map(|k| sample(near(k), n)));
        }
    }
    let stage = Stage::at_points(gpu, &scene, &points)?;
    let truth = |samples: &[ViewSample]| {
        stage.tracer().truth(&light, samples, &TruthOptions::default()).visibility
    };
    let (true_here, true_around) = (truth(&points), truth(&around));
    let shot = stage.shoot(gpu, &light, technique, 0)?;
    let (mut wrong, mut judged) = (0, 0);
    for ((v, here), around) in
        shot.visibility.iter().zip(&true_here).zip(true_around.chunks(NEAR as usize))
    {
        if around.iter().all(|a| a == here) {
            judged += 1;
            wrong += usize::from((v - here).abs() > 1e-5);
        }
    }
    Ok(f64::from(wrong as u32) / f64::from(judged))
}

/// Texels a side of HC-10's floor.
const FINE_TEXELS: u32 = 64;

/// HC-10: share of the samples of a lone level floor that are not fully lit, with a quad for every half texel a
/// side: eight triangles a texel.
pub(super) fn fine_floor(
    gpu: &Gpu,
    technique: &mut dyn Technique,
    map_size: u32,
) -> Result<f64, MeasureError> {
    const SAMPLES: usize = 1 << 14;
    const HALF: f64 = 10.0;
    // 64 texels of it are as good as all of a larger map, which two specks at its corners hold to its size.
    let texels = map_size.min(FINE_TEXELS);
    let half = HALF * f64::from(texels) / f64::from(map_size);
    let mut scene = Scene::default();
    scene.add(grid(half, 2 * texels), DAffine3::IDENTITY);
    if texels < map_size {
        let speck = 0.25 * HALF / f64::from(map_size);
        for sign in [-1.0, 1.0] {
            let center = DVec3::new(sign, 0.0, sign) * (HALF - speck);
            let quad = shapes::quad(center, speck * DVec3::Z, speck * DVec3::X);
            scene.add(quad, DAffine3::IDENTITY);
        }
    }
    let origin = scene.origin();
    let points: Vec<ViewSample> = unit_cube(SAMPLES)
        .map(|[a, b, _]| {
            let p = DVec3::new(2.0 * a - 1.0, 0.0, 2.0 * b - 1.0) * half;
            ViewSample { position: (p - origin).as_vec3(), normal: Vec3::Y }
        })
        .collect();
    let mut stage = Stage::at_points(gpu, &scene, &points)?;
    stage.meshes.set_culling(false);
    let shot = stage.shoot(gpu, &Light::sun(70_f64.to_radians(), 0.0, 0.0), technique, 0)?;
    let dark = shot.visibility[..SAMPLES].iter().filter(|v| **v != 1.0).count();
    Ok(dark as f64 / SAMPLES as f64)
}

/// A level square around the origin of `count` x `count` quads.
fn grid(half: f64, count: u32) -> Mesh {
    let at = |i: u32| (2.0 * f64::from(i) / f64::from(count) - 1.0) * half;
    let positions = (0..=count)
        .flat_map(|j| (0..=count).map(move |i| DVec3::new(at(i), 0.0, at(j)).as_vec3()))
        .collect();
    let mut triangles = Vec::new();
    for j in 0..count {
        for i in 0..count {
            let a = j * (count + 1) + i;
            let (b, c, d) = (a + 1, a + count + 1, a + count + 2);
            triangles.extend([[a, c, b], [b, c, d]]);
        }
    }
    Mesh { name: "grid".to_owned(), positions, triangles }
}
