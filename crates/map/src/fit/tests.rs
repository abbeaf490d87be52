//! What fitted views hold, and how they follow the camera.

use antumbra_gpu::ViewCamera;

use super::*;
use crate::visible::side;

const FITTING: Fitting =
    Fitting { origin: DVec3::ZERO, size: 256, guard: 2, receivers: false, grid: 1 };

fn cube_corners(center: DVec3, half: f64) -> Vec<DVec3> {
    (0..8)
        .map(|i| {
            let sign = |bit: usize| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
            center + half * DVec3::new(sign(0), sign(1), sign(2))
        })
        .collect()
}

fn lights() -> Vec<Light> {
    vec![
        Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 },
        Light::Directional { direction: DVec3::new(0.3, -1.0, 0.2), angular_diameter: 0.0 },
        Light::Spot { position: DVec3::Y * 9.0, direction: DVec3::NEG_Y, outer_angle: 0.7 },
        Light::Point { position: DVec3::new(0.1, 0.2, 0.3) },
        Light::Point { position: DVec3::new(0.0, 7.0, 1.0) },
    ]
}

#[test]
fn every_caster_in_reach_lands_inside_the_guard_band() {
    let points = cube_corners(DVec3::ZERO, 1.0);
    let inner = 1.0 - 2.0 * f64::from(FITTING.guard) / f64::from(FITTING.size) + 1e-12;
    for light in lights() {
        let views = fit(&light, &points, &FITTING).expect("the light is valid");
        for p in &points {
            let seen = views.iter().filter_map(|v| v.clip).any(|clip| {
                let c = clip * p.extend(1.0);
                c.w > 0.0
                    && c.x.abs() <= c.w * inner
                    && c.y.abs() <= c.w * inner
                    && c.z > 0.0
                    && c.z < c.w
            });
            assert!(seen, "{light:?} misses the caster corner {p}");
        }
    }
}

#[test]
fn depth_decreases_away_from_the_light() {
    for light in lights() {
        let views = fit(&light, &cube_corners(DVec3::ZERO, 1.0), &FITTING).expect("valid light");
        let view = views.iter().find(|v| v.clip.is_some()).expect("a view with casters");
        let clip = view.clip.expect("a view with casters");
        let away = match light {
            Light::Directional { direction, .. } => direction,
            _ => -clip.row(3).truncate() * -1.0,
        };
        let depth = |p: DVec3| clip.project_point3(p).z;
        let p = view.light.truncate() * view.light.w + away.normalize() * 5.0;
        assert!(depth(p) > depth(p + away), "{light:?} has no reversed depth");
    }
}

#[test]
fn a_light_without_casters_needs_no_view() {
    for light in lights() {
        let views = fit(&light, &[], &FITTING).expect("the light is valid");
        assert!(views.iter().all(|v| v.clip.is_none()), "{light:?} has a view of nothing");
    }
}

#[test]
fn casters_outside_the_cone_or_behind_the_light_need_no_view() {
    let spot = Light::Spot { position: DVec3::ZERO, direction: DVec3::NEG_Y, outer_angle: 0.3 };
    for center in [DVec3::new(9.0, -3.0, 0.0), DVec3::Y * 5.0] {
        let views = fit(&spot, &cube_corners(center, 1.0), &FITTING).expect("valid light");
        assert_eq!(views[0].clip, None, "casters at {center} cannot be seen");
    }
}

#[test]
fn bad_lights_are_refused_with_a_reason() {
    let bad = [
        Light::Directional { direction: DVec3::ZERO, angular_diameter: 0.0 },
        Light::Directional { direction: DVec3::NAN, angular_diameter: 0.0 },
        Light::Point { position: DVec3::INFINITY },
        Light::Spot { position: DVec3::ZERO, direction: DVec3::X, outer_angle: 1.6 },
        Light::Spot { position: DVec3::ZERO, direction: DVec3::X, outer_angle: 0.0 },
    ];
    for light in bad {
        let refused = fit(&light, &cube_corners(DVec3::ZERO, 1.0), &FITTING);
        assert!(matches!(refused, Err(GpuError::Invalid { .. })), "{light:?} passed");
    }
}

#[test]
fn degenerate_casters_still_give_finite_views() {
    for light in lights() {
        for points in [vec![DVec3::ZERO], vec![DVec3::ZERO, DVec3::X], vec![DVec3::splat(1e6)]] {
            for size in [1, 2, 8192] {
                let fitting = Fitting { size, ..FITTING };
                for view in fit(&light, &points, &fitting).expect("valid light") {
                    let finite = view.clip.is_none_or(|c| c.as_mat4().is_finite());
                    assert!(finite, "{light:?} over {points:?}: {view:?}");
                }
            }
        }
    }
}

/// Houses of a town of 20 x 20, world space.
fn town() -> Vec<Bounds> {
    let house = |x: i32, z: i32| {
        let min = DVec3::new(f64::from(x) * 10.0, 0.0, f64::from(z) * 10.0);
        Bounds { min, max: min + DVec3::new(6.0, f64::from(1 + (x * 7 + z * 3) % 5), 6.0) }
    };
    (0..20).flat_map(|x| (0..20).map(move |z| house(x, z))).collect()
}

fn corners(boxes: &[Bounds]) -> Vec<DVec3> {
    boxes.iter().flat_map(Bounds::corners).collect()
}

fn region(eye: DVec3, forward: DVec3, receivers: &[Bounds]) -> VisibleRegion {
    let camera =
        antumbra_scene::Camera { eye, target: eye + forward, up: DVec3::Y, fov_y: 0.9, near: 0.1 };
    let clip = camera.view_projection(DVec3::ZERO, 1.3);
    VisibleRegion::new(&ViewCamera { clip, eye }, receivers, DVec3::ZERO).expect("a camera")
}

/// Half of the texels' number over metres (of the light's plane, or at distance 1), on both axes.
fn scales(clip: &DMat4) -> [f64; 2] {
    let w = clip.row(3).truncate();
    [0, 1].map(|i| {
        let row = clip.row(i).truncate();
        (row - w * row.dot(w) / w.length_squared().max(1e-300)).length()
    })
}

fn town_lights() -> Vec<Light> {
    let lamp = DVec3::new(98.0, 7.0, 103.0);
    vec![
        Light::sun(0.8, 0.6, 0.0),
        Light::sun(1.5, 0.1, 0.01),
        Light::Spot {
            position: lamp,
            direction: DVec3::new(0.5, -1.0, -0.6).normalize(),
            outer_angle: 0.7,
        },
        Light::Point { position: lamp },
        Light::Sphere { center: lamp, radius: 0.5 },
    ]
}

/// Corners of casters in a view's half-spaces lie between its ends, or before its near plane.
fn ends_hold_what_is_in_the_volume(seen: &[SeenView], casters: &[Bounds]) {
    for SeenView { view, volume, ends } in seen {
        let (Some(clip), Some([near, last_caster, far])) = (&view.clip, ends) else { continue };
        // Depth grows towards the light for both projections.
        let depth = |p: DVec3| {
            let c = clip * p.extend(1.0);
            if c.w > 0.0 { c.z / c.w } else { f64::INFINITY }
        };
        for corner in corners(casters) {
            if volume.iter().all(|plane| side(plane, corner) >= 0.0) {
                let found = depth(corner);
                let (first, last) = (depth(*near), depth(*last_caster));
                assert!(depth(*far) <= last, "receivers go on behind the casters");
                assert!(found >= last * (1.0 - 1e-9), "{corner} beyond the far end");
                assert!(
                    found <= first * (1.0 + 1e-9) || found > 1.0,
                    "{corner} before the near end"
                );
            }
        }
    }
}

#[test]
fn a_fit_to_what_is_seen_is_no_wider_and_holds_every_caster_that_matters() {
    let town = town();
    let (mut receivers, hull) = (town.clone(), corners(&town));
    receivers.push(Bounds { min: DVec3::new(0.0, 0.0, 0.0), max: DVec3::new(200.0, 0.0, 200.0) });
    let fitting = Fitting { size: 1024, ..FITTING };
    let mut narrower = 0;
    for turn in 0..24 {
        let angle = f64::from(turn) * 0.7;
        let eye = DVec3::new(97.0 + f64::from(turn), 1.7, 98.0);
        let forward = DVec3::new(angle.cos(), -0.2, angle.sin());
        let region = region(eye, forward, &receivers);
        for light in town_lights() {
            let all = fit(&light, &hull, &fitting).expect("valid");
            let sight = Sight { region: &region, casters: &town };
            let seen = fit_seen(&light, &hull, Some(&sight), &fitting).expect("valid");
            for (all, seen) in all.iter().zip(&seen) {
                let Some(clip) = seen.view.clip else { continue };
                let all = scales(&all.clip.expect("more casters than are seen"));
                let scales = scales(&clip);
                assert!((0..2).all(|i| scales[i] >= all[i] * (1.0 - 1e-12)), "{light:?}: wider");
                narrower += usize::from(scales[0] * scales[1] > 4.0 * all[0] * all[1]);
            }
            ends_hold_what_is_in_the_volume(&seen, &town);
            // A point of a caster between a corner of the region and the light, in the view that looks there.
            let receivers: Vec<DVec3> = region.corners().collect();
            for (i, p) in receivers.iter().enumerate() {
                let towards = light.towards(*p, DVec2::splat(0.5));
                let reach = if light.position().is_some() { 1.0 } else { 60.0 };
                for step in 0..50 {
                    let q = *p + towards * (reach * (f64::from(step) + 0.5) / 50.0);
                    let within = |b: &Bounds| q.cmpge(b.min).all() && q.cmple(b.max).all();
                    if !town.iter().any(within) {
                        continue;
                    }
                    let shown = seen.iter().filter_map(|v| v.view.clip).any(|clip| {
                        let c = clip * q.extend(1.0);
                        c.w > 0.0 && c.x.abs() <= c.w && c.y.abs() <= c.w && c.z > 0.0 && c.z <= c.w
                    });
                    let near = light.position().is_some_and(|l| l.distance(q) < 0.1);
                    let cone = match light {
                        Light::Spot { position, direction, outer_angle } => {
                            (q - position).angle_between(direction) < outer_angle
                        }
                        _ => true,
                    };
                    assert!(shown || near || !cone, "{light:?}: {q} before corner {i} is cut off");
                }
            }
        }
    }
    assert!(narrower > 40, "only {narrower} windows are less than half as wide");
}

#[test]
fn a_window_that_follows_the_camera_moves_in_whole_texels_or_multiples_of_them() {
    let town = town();
    let hull = corners(&town);
    let p = DVec3::new(100.0, 0.5, 95.0);
    let [sun, _, lamp] = town_lights()[..3] else { panic!("three lights") };
    for (light, grid) in [(sun, 1), (lamp, 1), (sun, 8), (lamp, 8)] {
        let fitting = Fitting { size: 1024, grid, ..FITTING };
        let mut before: Option<DMat4> = None;
        let (mut moves, mut stays) = (0, 0);
        for frame in 0..400 {
            let eye = DVec3::new(97.0 + 0.003 * f64::from(frame), 1.7, 98.0);
            let region = region(eye, DVec3::new(0.2, -0.3, -1.0), &town);
            let sight = Sight { region: &region, casters: &town };
            let seen = fit_seen(&light, &hull, Some(&sight), &fitting).expect("valid");
            let clip = seen[0].view.clip.expect("houses in view");
            if let Some(before) = before {
                let change = clip.project_point3(p) - before.project_point3(p);
                let texels = change.truncate() * 0.5 * f64::from(fitting.size);
                let (was, is) = (scales(&before), scales(&clip));
                for i in 0..2 {
                    if (was[i] - is[i]).abs() > 1e-9 * is[i] {
                        continue;
                    }
                    let steps = texels[i] / f64::from(grid);
                    assert!((steps - steps.round()).abs() < 1e-6, "{light:?}: {texels}");
                    moves += usize::from(texels[i].abs() > 0.5);
                    stays += usize::from(texels[i].abs() < 0.5);
                }
            }
            before = Some(clip);
        }
        assert!(moves > 0 && stays > moves, "{light:?}: {moves} moves, {stays} frames without");
    }
}

#[test]
fn what_lies_beside_a_ray_is_within_a_turned_half_space_at_every_distance() {
    let (eye, front, tilt, farthest) = (DVec3::new(1.0, 2.0, 3.0), DVec3::NEG_Z, 0.02, 10.0);
    let margin = tilt * farthest;
    let (mut held, mut lost) = (0, 0);
    for k in 0..1000 {
        let [a, b, c, d] = [0.618, 0.755, 0.57, 0.325].map(|step| (f64::from(k) * step).fract());
        let angle = std::f64::consts::TAU * a;
        // A side through the eye, a ray within it, and a place a kernel's reach aside, before and beyond the farthest.
        let aside = DVec3::new(angle.cos(), angle.sin(), 0.0);
        let normal = (aside + (b - 0.5) * front).normalize();
        let moved_out = normal.extend(margin - normal.dot(eye));
        let ray = front + aside * (0.5 - b + 0.01 * d);
        let place = eye + (ray - aside * tilt) * (0.1 + 40.0 * c);
        assert!(side(&tilted(&moved_out, margin, tilt, (eye, front)), place) >= 0.0, "{k}");
        held += usize::from(side(&moved_out, place) >= 0.0);
        lost += usize::from(side(&moved_out, place) < 0.0);
    }
    assert!(held > 100 && lost > 100, "a side that is moved out holds {held} and loses {lost}");
    // One that does not go through the eye stays as it was.
    let other = DVec4::new(0.0, 0.0, 1.0, 5.0);
    assert_eq!(tilted(&other, margin, tilt, (eye, front)), other, "a far side");
}

#[test]
fn a_wide_fit_holds_what_hides_any_point_of_the_light_and_a_narrow_one_does_not() {
    let town = town();
    let (mut receivers, hull) = (town.clone(), corners(&town));
    receivers.push(Bounds { min: DVec3::new(0.0, 0.0, 0.0), max: DVec3::new(200.0, 0.0, 200.0) });
    let fitting = Fitting { size: 1024, ..FITTING };
    let center = DVec3::new(98.0, 12.0, 103.0);
    let tan_limit = DVec2::splat(3.0);
    let (mut narrower, mut missed) = (0, 0);
    for turn in 0..12 {
        let angle = f64::from(turn) * 0.7;
        let eye = DVec3::new(97.0 + f64::from(turn), 1.7, 98.0);
        let region = region(eye, DVec3::new(angle.cos(), -0.2, angle.sin()), &receivers);
        let sight = Some(Sight { region: &region, casters: &town });
        let sight = sight.as_ref();
        for light in [
            Light::sun(0.8, 0.6, 0.2),
            Light::Sphere { center, radius: 1.5 },
            Light::Rect { center, half_u: DVec3::X * 2.0, half_v: DVec3::Z },
        ] {
            // The receivers that each view serves, and its fit to all, to what counts, and to what the centre sees.
            let views: Vec<(Vec<DVec4>, [SeenView; 3])> = match light {
                Light::Directional { direction, .. } => {
                    let direction = direction.normalize();
                    let wide = |sight| fit_wide_sun(&light, direction, &hull, sight, &fitting);
                    let narrow =
                        fit_seen(&light, &hull, sight, &fitting).expect("valid")[0].clone();
                    vec![(Vec::new(), [wide(None), wide(sight), narrow])]
                }
                _ => DVec3::AXES
                    .into_iter()
                    .flat_map(|axis| [axis, -axis])
                    .map(|back| {
                        let basis = basis(back);
                        let served = cone(center, &basis, DVec2::ONE).to_vec();
                        let stand = (center, basis, tan_limit);
                        let wide = |sight| fit_wide(&light, stand, &served, &hull, sight, &fitting);
                        let narrow = fit_perspective(&light, stand, &hull, sight, &fitting);
                        let all = [wide(None), wide(sight), narrow];
                        (served, all)
                    })
                    .collect(),
            };
            for (served, [all, wide, narrow]) in &views {
                let (Some(all), Some(clip)) = (all.view.clip, wide.view.clip) else { continue };
                let (all, scales) = (scales(&all), scales(&clip));
                assert!((0..2).all(|i| scales[i] >= all[i] * (1.0 - 1e-12)), "{light:?}: wider");
                narrower += usize::from(scales[0] * scales[1] > 4.0 * all[0] * all[1]);
                let shows = |view: &SeenView, q: DVec3| {
                    view.view.clip.is_some_and(|clip| {
                        let c = clip * q.extend(1.0);
                        c.w > 0.0 && c.x.abs() <= c.w && c.y.abs() <= c.w && c.z > 0.0 && c.z <= c.w
                    })
                };
                let is_served = |p: &DVec3| served.iter().all(|s| side(s, *p) > 1e-9);
                for p in region.corners().filter(is_served) {
                    for sample in 0..16 {
                        let at = DVec2::new(f64::from(sample % 4), f64::from(sample / 4));
                        let towards = light.towards(p, (at + 0.5) / 4.0);
                        let reach = if light.position().is_some() { 1.0 } else { 60.0 };
                        for step in 0..30 {
                            let q = p + towards * (reach * (f64::from(step) + 0.5) / 30.0);
                            let within = |b: &Bounds| q.cmpge(b.min).all() && q.cmple(b.max).all();
                            if !town.iter().any(within) {
                                continue;
                            }
                            assert!(shows(wide, q), "{light:?}: {q} before {p} is cut off");
                            missed += usize::from(!shows(narrow, q));
                        }
                    }
                }
            }
        }
    }
    assert!(narrower > 20, "only {narrower} windows are less than half as wide");
    assert!(missed > 0, "the narrow fit misses nothing");
}
