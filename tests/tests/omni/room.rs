//! HC-11: a room of 10 m about a point light, with 8 poles of 5 cm at 2 m and 8 spheres in the directions of a cube's
//! corners. A pole's shadow is 0.25 m wide on the wall that it faces, and goes up and down the walls without a break,
//! whatever seams of the layout it crosses; a sphere's lies in a corner of the room.

use std::f64::consts::{FRAC_PI_4, SQRT_2, TAU};

use antumbra_gpu::Gpu;
use antumbra_map::{MapConfig, MapTechnique, Omni};
use antumbra_measure::Stage;
use antumbra_reference::ViewSample;
use antumbra_scene::{Light, Scene, generate::shapes};
use antumbra_tests::gpu;
use glam::{DAffine3, DVec3};

use super::{EXACT, on_wall};

const MAP: u32 = 1024;
const RADIUS: f64 = 0.05;
const DISTANCE: f64 = 2.0;

/// Half of the angle that poles and spheres span.
fn half_angle() -> f64 {
    (RADIUS / DISTANCE).asin()
}

fn room() -> Scene {
    let mut scene = Scene::default();
    scene.add(shapes::cuboid(DVec3::splat(-5.0), DVec3::splat(5.0)), DAffine3::IDENTITY);
    for i in 0..8 {
        let place = DISTANCE * level(f64::from(i) * FRAC_PI_4);
        let (from, to) = (place - 5.0 * DVec3::Y, place + 5.0 * DVec3::Y);
        // As the light sees it, the poles' edges at right angles to it are their outlines, as a round pole's nearly are.
        scene.add(shapes::frustum(from, to, RADIUS, RADIUS, 8), DAffine3::IDENTITY);
        let place = DAffine3::from_translation(DISTANCE * corner(i));
        scene.add(shapes::icosphere(3, RADIUS), place);
    }
    scene
}

/// The level direction of an azimuth.
fn level(azimuth: f64) -> DVec3 {
    let (sin, cos) = azimuth.sin_cos();
    DVec3::new(cos, 0.0, sin)
}

/// The direction of a cube's corner.
fn corner(i: i32) -> DVec3 {
    let sign = |bit: i32| if i >> bit & 1 == 0 { 1.0 } else { -1.0 };
    DVec3::new(sign(0), sign(1), sign(2)).normalize()
}

/// The largest angle between a sample and what decides for it: half of the diagonal of a layout's largest texel, and the
/// rasteriser's step. A cube's view is 2 wide in tangents and a tetrahedron's 2 x 3.08; a unit of the isocube is up to 1.2
/// radians, of the paraboloid 2, and both reach a little beyond themselves.
fn reach(omni: Omni) -> f64 {
    let width = match omni {
        Omni::Cube => 2.0,
        Omni::Tetrahedron => 2.0 * 3.077,
        Omni::Isocube => 2.0 * 1.2 * Omni::half_width(MAP, 1),
        Omni::DualParaboloid | Omni::WarpedParaboloid => 2.0 * 2.0 * Omni::half_width(MAP, 1),
    };
    SQRT_2 * (0.5 + 1.0 / 256.0) * width / f64::from(MAP - 4)
}

/// Directions to the walls with whether they are lit, none nearer to a shadow's edge than `reach`.
fn expected(reach: f64) -> Vec<(DVec3, bool)> {
    let mut all = Vec::new();
    for i in 0..8 {
        // Up to 3 m above and below the light, where an angle is larger as an azimuth: by sqrt(5^2 + 3^2) / 5.
        let aside = reach * 34_f64.sqrt() / 5.0;
        for k in 0..=120 {
            let height = f64::from(k - 60) / 60.0 * 0.6;
            for side in [-1.0, 1.0] {
                for (angle, is_lit) in [(half_angle() - aside, false), (half_angle() + aside, true)]
                {
                    let azimuth = f64::from(i) * FRAC_PI_4 + side * angle;
                    all.push((level(azimuth) + height * DVec3::Y, is_lit));
                }
            }
        }
        let axis = corner(i);
        // From the middles of the three walls, between which the light meets creases that are steeper than the bias cone.
        let to_wall = (axis.x.signum() * DVec3::X).reject_from_normalized(axis).normalize();
        for k in 0..3 {
            let out = glam::DQuat::from_axis_angle(axis, f64::from(k) * TAU / 3.0) * to_wall;
            for (angle, is_lit) in [(half_angle() - reach, false), (half_angle() + reach, true)] {
                // Above and below a sphere its pole's shadow goes on.
                all.push((axis + angle.tan() * out, is_lit && out.y.abs() < 0.5));
            }
        }
    }
    all
}

/// Numbers of directions on which a map is wrong, dark ones and lit ones; and the width of the shadow of the pole at
/// azimuth 0, metres.
fn look(gpu: &Gpu, omni: Omni, light: DVec3) -> ([usize; 2], f64) {
    const STEPS: i32 = 2000;
    let mut expected = expected(reach(omni));
    let known = expected.len();
    // Across the wall at x = 5, at the light's height but for a little.
    let step = 0.5 / f64::from(STEPS);
    expected.extend(
        (0..STEPS).map(|k| (DVec3::new(5.0, 0.1, step * (f64::from(k) + 0.5) - 0.25), true)),
    );
    let samples: Vec<ViewSample> = expected.iter().map(|(d, _)| on_wall(*d)).collect();
    let stage = Stage::at_points(gpu, &room(), &samples).expect("a stage");
    let map = MapConfig { size: MAP, omni, ..MapConfig::default() };
    let mut technique = MapTechnique::plain(gpu, &map).expect("a valid config");
    let light = Light::Point { position: light };
    let seen = stage.shoot(gpu, &light, &mut technique, 0).expect("a shot").visibility;
    let wrong = [false, true].map(|lit| {
        let of = |i: &usize| expected[*i].1 == lit && (seen[*i] > 0.5) != lit;
        (0..known).filter(of).count()
    });
    let dark = seen[known..].iter().filter(|v| **v < 0.5).count();
    (wrong, dark as f64 * step)
}

#[test]
fn shadows_of_poles_and_spheres_go_over_seams_and_are_as_wide_as_they_should() {
    let gpu = gpu();
    let exact = 2.0 * 5.0 * half_angle().tan();
    assert!((exact - 0.25).abs() < 1e-3, "two and a half times the pole's 0.1 m");
    for omni in EXACT {
        let (wrong, width) = look(&gpu, omni, DVec3::ZERO);
        assert_eq!(wrong, [0, 0], "{omni:?}: wrong in shadow and in light");
        let most = 2.0 * 5.0 * reach(omni);
        assert!((width - exact).abs() <= most, "{omni:?}: {width} m wide, to {most}");
    }
    // The control: a light 7 cm aside throws the shadows past them.
    let (wrong, _) = look(&gpu, Omni::Cube, DVec3::new(0.05, 0.0, 0.05));
    assert!(wrong.iter().all(|count| *count > 100), "{wrong:?}");
}
