//! Closed-form visibility on cases that can be worked out by hand.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

use antumbra_reference::closed::{
    Occluder, is_tie, joint_visibility, shadow_margin, visibility, visibility_above_horizon,
};
use antumbra_scene::Light;
use glam::{DVec3, dvec3};

/// The accuracy that the documentation promises.
const ACCURACY: f64 = 1e-12;

fn sun(direction: DVec3) -> Light {
    Light::Directional { direction, angular_diameter: 0.0 }
}

fn point(x: f64, y: f64, z: f64) -> Light {
    Light::Point { position: dvec3(x, y, z) }
}

fn square_light(y: f64, half: f64) -> Light {
    Light::Rect { center: dvec3(0.0, y, 0.0), half_u: DVec3::X * half, half_v: DVec3::Z * half }
}

/// A horizontal plate over [x0, x1] x [z0, z1] at height y.
fn plate(y: f64, x: [f64; 2], z: [f64; 2]) -> Occluder {
    let corner = |i: usize, j: usize| dvec3(x[i], y, z[j]);
    Occluder::ConvexPolygon(vec![corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)])
}

fn floor_grid() -> impl Iterator<Item = DVec3> {
    (-100..=100).flat_map(|i| {
        (-100..=100).map(move |k| dvec3(f64::from(i) * 0.05, 0.0, f64::from(k) * 0.05))
    })
}

#[test]
fn the_shadow_of_a_square_is_the_square_worked_out_by_hand() {
    let square = plate(2.0, [-1.0, 1.0], [-1.0, 1.0]);
    let spot =
        Light::Spot { position: dvec3(0.0, 6.0, 0.0), direction: DVec3::NEG_Y, outer_angle: 0.1 };
    let cases = [
        // Light, and the shadow's range in x and z.
        (point(0.0, 6.0, 0.0), [-1.5, 1.5], 1.5),
        (spot, [-1.5, 1.5], 1.5),
        (sun(DVec3::NEG_Y), [-1.0, 1.0], 1.0),
        // The light lies towards (1, 1, 0): the shadow falls to -x.
        (sun(dvec3(-FRAC_1_SQRT_2, -FRAC_1_SQRT_2, 0.0)), [-3.0, -1.0], 1.0),
    ];
    for (light, [x0, x1], z1) in cases {
        let mut ties = 0;
        for p in floor_grid() {
            if is_tie(&square, &light, p, 1e-9) {
                ties += 1;
                continue;
            }
            let dark = p.x > x0 && p.x < x1 && p.z.abs() < z1;
            let v = visibility(&square, &light, p);
            assert_eq!(v, if dark { 0.0 } else { 1.0 }, "{light:?} at {p}");
            let margin = shadow_margin(&square, &light, p);
            assert_eq!(margin > 0.0, dark, "{light:?} at {p}: margin {margin}");
        }
        // The grid has points on all four sides, 0.05 apart, and nowhere else on the boundary.
        let expected = 2.0 * (x1 - x0 + 2.0 * z1) / 0.05;
        assert_eq!(ties, expected.round() as i32, "{light:?}: the tie band is the boundary");
    }
}

#[test]
fn light_and_receiver_on_one_side_of_the_occluder_see_each_other() {
    let lid = plate(5.0, [-9.0, 9.0], [-9.0, 9.0]);
    assert_eq!(visibility(&lid, &point(0.0, 4.0, 0.0), DVec3::ZERO), 1.0, "light below the lid");
    assert_eq!(visibility(&lid, &point(0.0, 7.0, 0.0), dvec3(0.0, 6.0, 0.0)), 1.0, "both above");
    assert_eq!(visibility(&lid, &point(0.0, 7.0, 0.0), DVec3::ZERO), 0.0, "the lid between");
    assert_eq!(visibility(&lid, &sun(DVec3::Y), DVec3::ZERO), 1.0, "sun from below");
    assert_eq!(visibility(&lid, &square_light(4.0, 1.0), DVec3::ZERO), 1.0, "area light below");
    assert_eq!(visibility(&lid, &square_light(6.0, 1.0), DVec3::ZERO), 0.0, "area light above");
    let touching = dvec3(0.0, 5.0, 0.0);
    assert_eq!(visibility(&lid, &point(0.0, 7.0, 0.0), touching), 1.0, "ends do not block");
}

#[test]
fn a_light_standing_in_the_occluder_is_hidden_in_the_part_beyond() {
    // A vertical light from y = 4 to 6 behind a lid at y = 5 that fills the view.
    let light = Light::Rect { center: dvec3(0.0, 5.0, 0.0), half_u: DVec3::X, half_v: DVec3::Y };
    let lid = plate(5.25, [-90.0, 90.0], [-90.0, 90.0]);
    let v = visibility(&lid, &light, dvec3(0.0, 0.0, 3.0));
    assert!((v - 0.625).abs() < ACCURACY, "the light shows below 5.25: {v}");
}

#[test]
fn the_penumbra_of_a_half_plane_is_linear() {
    let (h_o, h_l, w) = (2.0, 6.0, 1.0);
    let light = square_light(h_l, 0.5 * w);
    let edge =
        Occluder::HalfPlane { point: dvec3(0.0, h_o, 0.0), normal: DVec3::Y, inward: DVec3::NEG_X };
    let width = w * h_o / (h_l - h_o);
    for i in 0..20 {
        // Strictly inside: from -0.475 to 0.475 of the width.
        let share = (f64::from(i) + 0.5) / 20.0;
        let p = dvec3((share - 0.5) * width, 0.0, 7.0 * share);
        let v = visibility(&edge, &light, p);
        assert!((v - share).abs() < ACCURACY, "{v} instead of {share}");
    }
    let at = |x: f64| visibility(&edge, &light, dvec3(x, 0.0, 0.3));
    assert_eq!((at(-0.51 * width), at(0.51 * width)), (0.0, 1.0), "umbra and light beside it");
    // Control: an edge elsewhere gives other values.
    let wrong =
        Occluder::HalfPlane { point: dvec3(0.1, h_o, 0.0), normal: DVec3::Y, inward: DVec3::NEG_X };
    assert!((visibility(&wrong, &light, DVec3::ZERO) - 0.5).abs() > 0.1, "the wrong edge shows");
}

#[test]
fn a_plate_half_way_hides_what_it_projects_to() {
    // Light of side 2 at 10: a plate at 5 projects to twice, at 4 to 2.5 times its size.
    let light = square_light(10.0, 1.0);
    let z = [-2.0, 2.0];
    let cases = [
        (plate(5.0, [-0.5, 0.0], z), 0.5),
        (plate(4.0, [-0.4, 0.0], z), 0.5),
        (plate(4.0, [0.0, 0.4], z), 0.5),
        (plate(4.0, [-0.2, 0.2], z), 0.5),
        (plate(5.0, [-0.25, 0.25], [-0.25, 0.25]), 0.75),
        (plate(5.0, [0.25, 9.0], [0.25, 9.0]), 1.0 - 0.0625),
    ];
    for (occluder, expected) in cases {
        let v = visibility(&occluder, &light, DVec3::ZERO);
        assert!((v - expected).abs() < ACCURACY, "{occluder:?}: {v}");
    }
    let near_light = plate(0.999, [0.002, 2.01], [-2.01, 2.01]);
    let v = visibility(&near_light, &square_light(1.0, 2.0), dvec3(2.0, 0.0, 0.0));
    assert!((v - 0.5).abs() < ACCURACY, "an occluder just below the light: {v}");
}

#[test]
fn plates_that_hide_half_each_hide_together_what_their_overlap_leaves() {
    let light = square_light(10.0, 1.0);
    let z = [-2.0, 2.0];
    let a = plate(5.0, [-0.5, 0.0], z);
    for (x, expected) in [([-0.4, 0.0], 0.5), ([0.0, 0.4], 0.0), ([-0.2, 0.2], 0.25)] {
        let b = plate(4.0, x, z);
        let joint = joint_visibility(&[a.clone(), b], &light, DVec3::ZERO).unwrap_or(f64::NAN);
        assert!((joint - expected).abs() < ACCURACY, "{x:?}: {joint} instead of {expected}");
    }
    // Three plates: quarters that overlap pairwise, and a disc within the first.
    let quarters = [
        plate(5.0, [-0.5, 0.0], [-0.5, 0.5]),
        plate(4.0, [-0.4, 0.4], [-0.4, 0.0]),
        Occluder::Disc { center: dvec3(-0.25, 5.0, 0.2), normal: DVec3::Y, radius: 0.1 },
    ];
    for order in [[0, 1, 2], [2, 1, 0], [1, 2, 0]] {
        let occluders = order.map(|i| quarters[i].clone());
        let joint = joint_visibility(&occluders, &light, DVec3::ZERO).unwrap_or(f64::NAN);
        assert!((joint - 0.25).abs() < ACCURACY, "{order:?}: {joint}");
    }
    // The disc's half that lies off the plate hides pi / 2 (2 r)² of the light's area of 4.
    let disc = Occluder::Disc { center: DVec3::Y * 5.0, normal: DVec3::Y, radius: 0.2 };
    let joint = joint_visibility(&[disc.clone(), a], &light, DVec3::ZERO).unwrap_or(f64::NAN);
    assert!((joint - (0.5 - PI * 0.02)).abs() < ACCURACY, "plate and disc: {joint}");
    let two = [disc.clone(), disc];
    assert_eq!(joint_visibility(&two, &light, DVec3::ZERO), None, "two discs, wide light");
    let hard = joint_visibility(&two, &point(0.0, 10.0, 0.0), DVec3::ZERO);
    assert_eq!(hard, Some(0.0), "two discs, point light");
}

#[test]
fn discs_hide_discs_as_circles_overlap() {
    let light = |r: f64| Light::Disc {
        center: DVec3::Y * 4.0,
        radius: r,
        axis_u: DVec3::X,
        axis_v: DVec3::Z,
    };
    let disc = |x: f64, r: f64| Occluder::Disc {
        center: dvec3(x, 2.0, 0.0),
        normal: DVec3::Y * 3.0,
        radius: r,
    };
    let v = |x: f64, r: f64| visibility(&disc(x, r), &light(1.0), DVec3::ZERO);
    assert!((v(0.0, 0.25) - 0.75).abs() < ACCURACY, "radius 1/2 projected: {}", v(0.0, 0.25));
    assert_eq!(v(0.0, 0.5), 0.0, "exactly covered");
    assert_eq!(v(0.0, 0.6), 0.0, "covered");
    assert_eq!(v(1.01, 0.5), 1.0, "beside");
    // Two unit circles at distance 1 share 2 pi / 3 - sqrt(3) / 2.
    let lens = 2.0 * PI / 3.0 - 0.75_f64.sqrt();
    assert!((v(0.5, 0.5) - (1.0 - lens / PI)).abs() < ACCURACY, "lens: {}", v(0.5, 0.5));
    // A straight edge half way out leaves a circular segment: pi / 3 - sqrt(3) / 4.
    let edge = Occluder::HalfPlane {
        point: dvec3(0.25, 2.0, 0.0),
        normal: DVec3::NEG_Y,
        inward: dvec3(1.0, 5.0, 0.0),
    };
    let segment = PI / 3.0 - 0.1875_f64.sqrt();
    let found = visibility(&edge, &light(1.0), DVec3::ZERO);
    assert!((found - (1.0 - segment / PI)).abs() < ACCURACY, "segment: {found}");
    // A disc inside a square light.
    let found = visibility(&disc(0.0, 0.25), &square_light(4.0, 1.0), DVec3::ZERO);
    assert!((found - (1.0 - PI / 16.0)).abs() < ACCURACY, "disc in square: {found}");
}

#[test]
fn a_disc_seen_at_a_slant_is_an_ellipse() {
    // From straight below, a disc of radius 0.3 tilted by 60 degrees about x, under a sun 40 degrees
    // wide: rays to it fill an oblique cone. Against the same sun behind its inscribed and
    // circumscribed polygons of n sides, whose areas differ from the disc's by pi² / n² at most.
    let n = 1024;
    let (tilt_u, tilt_v) =
        (DVec3::X, dvec3(0.0, 60_f64.to_radians().cos(), 60_f64.to_radians().sin()));
    let normal = tilt_u.cross(tilt_v);
    let lights = [
        Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 40_f64.to_radians() },
        Light::Sphere { center: dvec3(0.3, 6.0, -0.2), radius: 1.5 },
        square_light(5.0, 1.2),
        Light::Disc {
            center: dvec3(0.1, 5.0, 0.4),
            radius: 1.5,
            axis_u: DVec3::X,
            axis_v: DVec3::Z,
        },
    ];
    let mut partly = 0;
    for light in lights {
        for center in [dvec3(0.0, 1.0, 0.0), dvec3(0.3, 1.5, 0.2), dvec3(-0.4, 2.0, 0.3)] {
            let disc = Occluder::Disc { center, normal, radius: 0.3 };
            let polygon = |radius: f64| {
                let corner = |i: i32| {
                    let a = 2.0 * PI * f64::from(i) / f64::from(n);
                    center + (tilt_u * a.cos() + tilt_v * a.sin()) * radius
                };
                Occluder::ConvexPolygon((0..n).map(corner).collect())
            };
            let v = visibility(&disc, &light, DVec3::ZERO);
            let inside = visibility(&polygon(0.3), &light, DVec3::ZERO);
            let outside =
                visibility(&polygon(0.3 / (PI / f64::from(n)).cos()), &light, DVec3::ZERO);
            assert!(outside - ACCURACY <= v && v <= inside + ACCURACY, "{outside} {v} {inside}");
            assert!(inside - outside <= 10.0 / f64::from(n * n), "a loose bracket: {light:?}");
            partly += i32::from(v > 0.0 && v < 1.0);
        }
    }
    assert!(partly >= 8, "most cases lie in the penumbra, not {partly}");
}

#[test]
fn mirrored_scenes_see_the_same() {
    let lights = [
        square_light(6.0, 0.7),
        Light::Sphere { center: dvec3(0.0, 6.0, 0.0), radius: 0.8 },
        Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.3 },
    ];
    let occluders = [
        plate(2.0, [-1.0, 1.0], [-1.0, 1.0]),
        Occluder::Disc { center: DVec3::Y * 2.0, normal: DVec3::Y, radius: 1.0 },
    ];
    for light in &lights {
        for occluder in &occluders {
            for i in 0..40 {
                let p = dvec3(f64::from(i) * 0.05, 0.0, f64::from(i % 7) * 0.1);
                let v = visibility(occluder, light, p);
                for q in [dvec3(-p.x, 0.0, p.z), dvec3(p.x, 0.0, -p.z), dvec3(p.z, 0.0, p.x)] {
                    let w = visibility(occluder, light, q);
                    assert!((v - w).abs() < ACCURACY, "{v} at {p}, {w} at {q}");
                }
            }
        }
    }
}

#[test]
fn the_horizon_hides_what_is_below_it() {
    // A vertical light whose centre is at the receiver's height: half is below.
    let light = Light::Rect { center: DVec3::X * 5.0, half_u: DVec3::Y, half_v: DVec3::Z };
    let disc =
        Light::Disc { center: DVec3::X * 5.0, radius: 1.0, axis_u: DVec3::Y, axis_v: DVec3::Z };
    let nothing = Occluder::ConvexPolygon(Vec::new());
    let wall = Occluder::HalfPlane { point: DVec3::X, normal: DVec3::X, inward: DVec3::Z };
    for light in [light, disc] {
        let v = |o: &Occluder, n: DVec3| visibility_above_horizon(o, &light, DVec3::ZERO, n);
        assert!((v(&nothing, DVec3::Y * 2.0) - 0.5).abs() < ACCURACY, "half above the horizon");
        assert_eq!(v(&nothing, DVec3::X), 1.0, "facing the light");
        assert_eq!(v(&nothing, DVec3::NEG_X), 0.0, "facing away");
        assert!((v(&wall, DVec3::Y) - 0.25).abs() < ACCURACY, "half of it behind the wall");
        assert!((visibility(&wall, &light, DVec3::ZERO) - 0.5).abs() < ACCURACY, "no horizon");
    }
    let below = point(0.0, -1.0, 0.0);
    assert_eq!(visibility_above_horizon(&nothing, &below, DVec3::ZERO, DVec3::Y), 0.0, "below");
    assert_eq!(visibility(&nothing, &below, DVec3::ZERO), 1.0, "without a horizon");
}

#[test]
fn a_shrinking_light_casts_the_shadow_of_its_centre() {
    let square = plate(2.0, [-1.0, 1.0], [-1.0, 1.0]);
    let disc = Occluder::Disc { center: DVec3::Y * 2.0, normal: dvec3(0.2, 1.0, 0.1), radius: 1.0 };
    let size = 1e-6;
    let center = dvec3(0.3, 6.0, -0.2);
    let down = dvec3(0.1, -1.0, 0.2).normalize();
    let pairs = [
        (Light::Sphere { center, radius: size }, Light::Point { position: center }),
        (
            Light::Disc { center, radius: size, axis_u: DVec3::X, axis_v: DVec3::Z },
            Light::Point { position: center },
        ),
        (
            Light::Rect { center, half_u: DVec3::X * size, half_v: DVec3::Z * size },
            Light::Point { position: center },
        ),
        (Light::Directional { direction: down, angular_diameter: size }, sun(down)),
    ];
    for (soft, hard) in pairs {
        for occluder in [&square, &disc] {
            for p in floor_grid().step_by(17) {
                // The light's corner moves the shadow by sqrt(2) size h_o / (h_l - h_o) or less,
                // with a factor of 2 for the slanted disc.
                if !is_tie(occluder, &hard, p, 4.0 * size) {
                    let (s, h) = (visibility(occluder, &soft, p), visibility(occluder, &hard, p));
                    assert_eq!(s, h, "{soft:?} at {p}");
                }
            }
        }
    }
    let zero = Light::Sphere { center, radius: 0.0 };
    assert_eq!(visibility(&square, &zero, DVec3::ZERO), 0.0, "a sphere without size is a point");
}

#[test]
fn a_line_light_is_a_thin_rectangle() {
    let light =
        |v: f64| Light::Rect { center: DVec3::Y * 10.0, half_u: DVec3::X, half_v: DVec3::Z * v };
    for occluder in [
        plate(5.0, [-0.25, 0.25], [-1.0, 1.0]),
        Occluder::Disc { center: DVec3::Y * 5.0, normal: dvec3(0.5, 1.0, 0.0), radius: 0.3 },
    ] {
        let (line, thin) = (
            visibility(&occluder, &light(0.0), DVec3::ZERO),
            visibility(&occluder, &light(1e-7), DVec3::ZERO),
        );
        assert!((line - thin).abs() < 1e-11, "{line} and {thin}");
        assert!(line > 0.1 && line < 0.9, "partly hidden: {line}");
    }
}

#[test]
fn coordinates_far_from_the_origin_change_little() {
    let shift = dvec3(1e6, -2e6, 5e5);
    let light = |o: DVec3| Light::Sphere { center: o + dvec3(0.5, 6.0, 0.0), radius: 1.0 };
    let disc = |o: DVec3| Occluder::Disc {
        center: o + dvec3(0.0, 2.0, 0.0),
        normal: dvec3(0.1, 1.0, 0.0),
        radius: 0.7,
    };
    let here = visibility(&disc(DVec3::ZERO), &light(DVec3::ZERO), dvec3(0.5, 0.0, 0.2));
    let there = visibility(&disc(shift), &light(shift), shift + dvec3(0.5, 0.0, 0.2));
    // A unit in the last place of 2e6 is 2.3e-10; the penumbra is of the order of a metre.
    assert!((here - there).abs() < 5e-9, "{here} and {there}");
    assert!(here > 0.0 && here < 1.0, "in the penumbra: {here}");
}

#[test]
fn degenerate_occluders_hide_nothing() {
    let light = square_light(5.0, 1.0);
    let line = Occluder::ConvexPolygon(vec![dvec3(-1.0, 1.0, 0.0), dvec3(1.0, 1.0, 0.0)]);
    let thin = Occluder::ConvexPolygon(vec![DVec3::Y; 4]);
    let dot = Occluder::Disc { center: DVec3::Y, normal: DVec3::Y, radius: 0.0 };
    let edge_on = Occluder::Disc { center: DVec3::Y, normal: DVec3::X, radius: 1.0 };
    let no_side = Occluder::HalfPlane { point: DVec3::Y, normal: DVec3::Y, inward: DVec3::Y };
    for occluder in [line, thin, dot, edge_on, no_side] {
        assert_eq!(visibility(&occluder, &light, DVec3::ZERO), 1.0, "{occluder:?}");
    }
}

#[test]
fn input_that_is_not_finite_gives_no_number() {
    let light = square_light(5.0, 1.0);
    let good = plate(2.0, [-1.0, 1.0], [-1.0, 1.0]);
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let occluders = [
            plate(bad, [-1.0, 1.0], [-1.0, 1.0]),
            Occluder::Disc { center: DVec3::Y, normal: DVec3::Y, radius: bad },
            Occluder::HalfPlane { point: DVec3::Y, normal: DVec3::Y, inward: DVec3::X * bad },
        ];
        for occluder in occluders {
            assert!(visibility(&occluder, &light, DVec3::ZERO).is_nan(), "{occluder:?}");
        }
        assert!(visibility(&good, &square_light(bad, 1.0), DVec3::ZERO).is_nan(), "light at {bad}");
        assert!(visibility(&good, &light, DVec3::X * bad).is_nan(), "receiver at {bad}");
        let sphere = Light::Sphere { center: DVec3::Y, radius: bad };
        assert!(visibility(&good, &sphere, DVec3::ZERO).is_nan(), "sphere of radius {bad}");
        let tilted = visibility_above_horizon(&good, &light, DVec3::ZERO, DVec3::Y * bad);
        assert!(tilted.is_nan(), "normal of length {bad}");
    }
}
