//! The picture of the sampling error, against its f64 twin, the model of beams, and the resolution of map and view.

use antumbra_gpu::Gpu;
use antumbra_map::{FittedView, Fitting, Layout, SamplingError, TexelOnScreen, fit};
use antumbra_measure::Stage;
use antumbra_reference::ViewSample;
use antumbra_reference::sampling::{Meeting, Parametrisation, ViewFrustum};
use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Camera, Light, LightKind, Scene};
use antumbra_tests::gpu;
use glam::{DAffine3, DMat4, DVec2, DVec3, DVec4, Vec3};

/// Unit roundoff of f32.
const U: f64 = 1.0 / 16_777_216.0;

/// Sides of a texel along s and t at every view sample of `stage`.
fn measure(
    gpu: &Gpu,
    stage: &Stage,
    layout: Layout,
    views: &[FittedView],
    size: u32,
) -> Vec<DVec2> {
    let sampling = stage.sampling(gpu, layout, views, size).expect("measured");
    sampling.sides.iter().map(|s| s.as_dvec2()).collect()
}

fn camera_clip(stage: &Stage) -> DMat4 {
    stage.camera().expect("a camera").clip
}

fn fitted(stage: &Stage, light: &Light, size: u32) -> Vec<FittedView> {
    let mut hull = Vec::new();
    antumbra_gpu::Casters::hull(&stage.meshes, light, &mut |p| hull.push(p));
    let fitting =
        Fitting { origin: stage.triangles.origin, size, guard: 2, receivers: false, grid: 1 };
    fit(light, &hull, &fitting).expect("a valid light")
}

/// Bound on the rounding of `shift` in `map/sampling_error.wesl` in f32, for a matrix and a point that are exact: with
/// S the sum of magnitudes of a row's products, 4 u S of the position, 3 u S of the direction, and as much for the
/// quotients and products, each entry of the change is off by at most 12 u times the magnitudes that make it up.
fn shift_rounding(clip: &DMat4, p: DVec3, size: DVec2) -> f64 {
    let a = p.abs();
    let m = [clip.x_axis.abs(), clip.y_axis.abs(), clip.z_axis.abs(), clip.w_axis.abs()];
    let at: DVec4 = m[0] * a.x + m[1] * a.y + m[2] * a.z + m[3];
    let along: DVec4 = m[0] + m[1] + m[2];
    let w = (*clip * p.extend(1.0)).w;
    let ndc = at.truncate().max_element() / w;
    12.0 * U * (along.truncate().max_element() + ndc * along.w) / w
        * (1.0 + at.w / w)
        * 0.5
        * size.max_element()
}

#[test]
fn the_picture_is_that_of_the_twin_under_every_kind_of_light() {
    let gpu = gpu();
    let scene = generate::sphere_over_plane(&Default::default());
    let stage = Stage::new(&gpu, &scene, scene.camera_or_framing(), 128, 128).expect("a stage");
    // As the shader has them.
    let rounded = |m: &DMat4| m.as_mat4().as_dmat4();
    let camera = rounded(&camera_clip(&stage));
    let (pixels, size) = (DVec2::splat(128.0), 512_u32);
    for kind in [LightKind::Directional, LightKind::Spot, LightKind::Point] {
        let light = scene.place_light(kind);
        let views = fitted(&stage, &light, size);
        let found = measure(&gpu, &stage, Layout::of(&light), &views, size);
        let (mut compared, mut loose) = (0, 0);
        for (sample, sides) in stage.view_samples().iter().zip(&found) {
            if *sides == DVec2::ZERO {
                continue;
            }
            let (p, n) = (sample.position.as_dvec3(), sample.normal.as_dvec3());
            let of_view = |clip: &DMat4| {
                TexelOnScreen::new(&camera, pixels, &rounded(clip), size.into(), p, n)
            };
            // The view that the point is in; for a cube, where two are in question, the nearer to its axis.
            let clip = views
                .iter()
                .filter_map(|v| v.clip)
                .max_by(|a, b| {
                    let w = |m: &DMat4| (*m * p.extend(1.0)).w;
                    w(a).total_cmp(&w(b))
                })
                .expect("a view with casters");
            let twin = of_view(&clip);
            // J = A B^-1: |dJ| <= (|dA| + |J| |dB|) |B^-1|, to first order, in norms of columns.
            let inverse = {
                // B^-1 is J without the camera: the change of the point a texel.
                let unit = TexelOnScreen::new(&camera, pixels, &rounded(&clip), size.into(), p, n);
                let (u, v) = n.any_orthonormal_pair();
                let c = camera * p.extend(1.0);
                let along = |d: DVec3| {
                    let e = camera * d.extend(0.0);
                    let ndc = (e.truncate() - c.truncate() / c.w * e.w) / c.w;
                    ndc.truncate() * DVec2::new(0.5, -0.5) * pixels
                };
                let a = glam::DMat2::from_cols(along(u), along(v));
                a.inverse() * unit.jacobian
            };
            let norm = |m: glam::DMat2| m.x_axis.length() + m.y_axis.length();
            let (da, db) = (
                2.0 * shift_rounding(&camera, p, pixels),
                2.0 * shift_rounding(&rounded(&clip), p, DVec2::splat(size.into())),
            );
            let bound = 2.0 * (da + norm(twin.jacobian) * db) * norm(inverse);
            // Where rounding may take half of the value, near edge-on, there is nothing to compare.
            if bound.is_nan() || bound >= 0.5 * twin.error() {
                loose += 1;
                continue;
            }
            compared += 1;
            let off = (*sides - twin.sides()).abs().max_element();
            assert!(off <= bound, "{kind:?} at {p}: {sides}, not {} within {bound}", twin.sides());
        }
        assert!(
            compared > 1000 && 20 * loose < compared,
            "{kind:?}: {compared} compared, {loose} not"
        );
    }
}

/// HC-29: an eye 1 m above the ground, 60 degrees, light from overhead onto 2000 texels over depths 1 to 50.
struct Hc29 {
    scene: Scene,
    camera: Camera,
    views: Vec<FittedView>,
}

fn hc29() -> Hc29 {
    let mut scene = Scene::default();
    scene.add(shapes::floor(60.0), DAffine3::IDENTITY);
    let eye = DVec3::Y;
    let fov_y = 60_f64.to_radians();
    let camera = Camera { eye, target: eye - DVec3::Z, up: DVec3::Y, fov_y, near: 1.0 };
    // s along x, over the width of the view at 50 m; t along the view's axis, from 1 m to 50 m.
    let (half, near, far) = (50.0 * (0.5 * fov_y).tan(), 1.0, 50.0);
    let row = |a: DVec4, b: DVec4| {
        DMat4::from_cols(a, b, DVec4::new(0.0, 1e-3, 0.0, 0.5), DVec4::W).transpose()
    };
    let t_scale = 2.0 / (far - near);
    let clip = row(
        DVec4::new(1.0 / half, 0.0, 0.0, 0.0),
        DVec4::new(0.0, 0.0, -t_scale, -(far + near) / (far - near)),
    );
    let light = DVec3::Y.extend(0.0);
    Hc29 { scene, camera, views: vec![FittedView { clip: Some(clip), light }] }
}

#[test]
fn the_ground_of_hc29_has_the_published_errors() {
    let Hc29 { scene, camera, views } = hc29();
    let gpu = gpu();
    let depths = [(2.0, 5.3044), (5.0, 0.84870), (20.0, 0.053044)];
    let points: Vec<ViewSample> = depths
        .iter()
        .map(|(z, _)| {
            let p = DVec3::new(0.0, 0.0, -z) - scene.origin();
            ViewSample { position: p.as_vec3(), normal: Vec3::Y }
        })
        .collect();
    // The picture is 1000 pixels a side, of which these are the first.
    let stage = Stage::seen(&gpu, &scene, &camera, (1000, 1000), &points).expect("a stage");
    let found = measure(&gpu, &stage, Layout::single(), &views, 2000);
    let view =
        ViewFrustum { tan_half: 30_f64.to_radians().tan(), aspect: 1.0, near: 1.0, far: 50.0 };
    let clip = views[0].clip.expect("a matrix");
    for ((depth, published), sides) in depths.into_iter().zip(&found) {
        // Five digits are published.
        assert!(
            (sides.y - published).abs() <= 1e-5 * published.max(1.0) + 1e-5 * published,
            "{depth} m: {sides}"
        );
        let p = DVec3::new(0.0, 0.0, -depth) - scene.origin();
        let twin = TexelOnScreen::new(
            &camera_clip(&stage),
            DVec2::splat(1000.0),
            &clip,
            2000.0,
            p,
            DVec3::Y,
        );
        let distance = f64::hypot(depth, 1.0);
        let meeting = Meeting {
            depth,
            eye_axis: depth / distance,
            eye_normal: 1.0 / distance,
            light_axis: 1.0,
            light_normal: 1.0,
            light_depth: 1.0,
        };
        let spread = view.spread(Parametrisation::Uniform, depth);
        let beams =
            meeting.beams(&view, DVec2::splat(1000.0), spread, DVec2::splat(2000.0)).error();
        // On the view's axis the beams' model is exact along both.
        let off = (twin.sides() - beams).abs() / beams;
        assert!(
            off.max_element() < 1e-9,
            "{depth} m: {} by the Jacobian, {beams} by beams",
            twin.sides()
        );
    }
    // What was not a sample is not looked up.
    assert!(found[3..].iter().all(|sides| *sides == DVec2::ZERO), "a pixel without a surface");
}

#[test]
fn twice_the_texels_halve_the_error_and_twice_the_pixels_double_it() {
    let gpu = gpu();
    let scene = generate::sphere_over_plane(&Default::default());
    let light = scene.place_light(LightKind::Spot);
    let median = |side: u32, size: u32| {
        let stage =
            Stage::new(&gpu, &scene, scene.camera_or_framing(), side, side).expect("a stage");
        // One fit for all sizes: the window's guard band changes with the size.
        let views = fitted(&stage, &light, 512);
        // The median: not moved by receivers edge-on to the light, nor by which pixels fall on edges.
        let sampling = stage.sampling(&gpu, Layout::single(), &views, size).expect("measured");
        f64::from(sampling.quantile(0.5).expect("samples"))
    };
    let base = median(128, 512);
    let (finer, larger) = (median(128, 1024), median(256, 512));
    assert!((finer / base - 0.5).abs() < 1e-6, "{base}, then {finer}");
    assert!((larger / base - 2.0).abs() < 0.02, "{base}, then {larger}");
}

#[test]
fn a_receiver_edge_on_to_the_light_has_the_longest_texel_and_one_that_faces_away_has_none() {
    let Hc29 { scene, camera, views } = hc29();
    let gpu = gpu();
    let at = |normal: DVec3| {
        let p = DVec3::new(0.0, 0.0, -5.0) - scene.origin();
        ViewSample { position: p.as_vec3(), normal: normal.as_vec3() }
    };
    let tilted = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        at(DVec3::new(0.0, cos, sin))
    };
    let points = [tilted(0.0), tilted(60.0), tilted(89.9), tilted(90.0 - 1e-5), tilted(100.0)];
    let stage = Stage::seen(&gpu, &scene, &camera, (1000, 1000), &points).expect("a stage");
    let found = measure(&gpu, &stage, Layout::single(), &views, 2000);
    // At 60 degrees: cos psi_j / cos psi_t is cos(90 - 60 - atan(1/5)) / cos 60 = 1.8973, of 1 / sqrt(26) flat.
    let eye = (1.0_f64 / 5.0).atan();
    let ratio = (std::f64::consts::FRAC_PI_6 - eye).cos() / 0.5 * 26_f64.sqrt();
    assert!(
        (found[1].y / found[0].y - ratio).abs() < 1e-4 * ratio,
        "{} of {}",
        found[1].y,
        found[0].y
    );
    assert!(found[2].y > 500.0 * found[0].y, "{}", found[2].y);
    assert_eq!(found[3].y, f64::from(SamplingError::LONGEST), "edge-on");
    assert_eq!(found[4], DVec2::ZERO, "facing away");
}

#[test]
fn a_wrong_number_of_views_or_no_camera_is_refused() {
    let gpu = gpu();
    let Hc29 { scene, camera, views } = hc29();
    let stage = Stage::new(&gpu, &scene, camera, 8, 8).expect("a stage");
    let refused = stage.sampling(&gpu, Layout::cube(), &views, 64);
    assert!(refused.is_err(), "one view for a cube");
    let nobody = Stage::at_points(&gpu, &scene, &stage.view_samples()).expect("a stage");
    let refused = nobody.sampling(&gpu, Layout::single(), &views, 64);
    assert!(refused.is_err(), "no camera");
}
