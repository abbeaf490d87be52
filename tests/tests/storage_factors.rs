//! How many texels a pixel the fitted maps need, measured on the GPU on the matrices that techniques build: the closed
//! forms, the curves of error over depth, and warps that are never worse than none.

use antumbra_gpu::{Gpu, Recorder, Technique as _, ViewCamera, read_f32_texture};
use antumbra_map::{FittedView, Layout, MapConfig, MapTechnique, SamplingError};
use antumbra_measure::Stage;
use antumbra_reference::ViewSample;
use antumbra_reference::sampling::{Parametrisation, ViewFrustum};
use antumbra_sampling::{CascadeFit, Cascades, Lispsm, Select, Splits};
use antumbra_scene::generate::shapes;
use antumbra_scene::{Camera, Light, Scene};
use antumbra_tests::gpu;
use glam::{DAffine3, DMat4, DVec2, DVec3, DVec4, Vec2, Vec2Swizzles as _};

const MAP: u32 = 2048;

/// Side of the picture, pixels, one a sample.
const SIDE: u32 = 32;

/// Half the picture's width and height at 1 m.
const TAN_HALF: f64 = 0.5;

/// A view from the origin along -z, from 1 m to `far`, all of which is in a body that casts and receives: fits have
/// nothing to go by but the view.
struct View {
    far: f64,
    stage: Stage,
}

/// A sample on a surface that eye and light meet at the same angle, so that its orientation adds nothing to the error.
fn sample(p: DVec3, to_light: DVec3) -> ViewSample {
    let normal = (to_light - p.normalize()).normalize_or_zero();
    ViewSample { position: p.as_vec3(), normal: normal.as_vec3() }
}

impl View {
    fn new(gpu: &Gpu, far: f64, samples: &[ViewSample]) -> Self {
        let mut scene = Scene::default();
        let half = DVec3::splat(1.01 * far);
        scene.add(shapes::cuboid(-half, half), DAffine3::IDENTITY);
        let seen = Camera {
            eye: DVec3::ZERO,
            target: -DVec3::Z,
            up: DVec3::Y,
            fov_y: 2.0 * TAN_HALF.atan(),
            near: 1.0,
        };
        let mut stage = Stage::seen(gpu, &scene, &seen, (SIDE, SIDE), samples).expect("a stage");
        let projection = DMat4::from_cols(
            DVec4::X / TAN_HALF,
            DVec4::Y / TAN_HALF,
            DVec4::new(0.0, 0.0, far / (1.0 - far), -1.0),
            DVec4::new(0.0, 0.0, far / (1.0 - far), 0.0),
        );
        let clip = projection * seen.view();
        stage.set_camera(Some(ViewCamera { clip, eye: DVec3::ZERO }));
        Self { far, stage }
    }

    /// The views that `technique` fits under `light`, and their layout.
    fn fitted(
        &self,
        gpu: &Gpu,
        technique: &mut MapTechnique,
        light: &Light,
    ) -> (Layout, Vec<FittedView>) {
        technique.prepare(gpu, &self.stage.frame(light)).expect("prepared");
        (technique.map().arrange().layout(light), technique.map().views().to_vec())
    }

    /// Sides of a texel at each sample, in units of pixels a texel, of a picture of one pixel and a map of one texel.
    fn sides(&self, gpu: &Gpu, pass: &mut SamplingError, views: &[FittedView]) -> Vec<DVec2> {
        let samples = &self.stage.samples;
        let target = SamplingError::target(gpu, samples).expect("a target");
        let output = target.create_view(&Default::default());
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut recorder = Recorder::new(&mut encoder);
        let camera = self.stage.camera().expect("a camera");
        pass.encode(gpu, &mut recorder, camera, samples, views, MAP, &output).expect("encoded");
        gpu.queue.submit([encoder.finish()]);
        let texels = read_f32_texture(gpu, &target, 0).expect("read back");
        let side = |s: &[f32]| Vec2::from_slice(s).as_dvec2() * f64::from(MAP) / f64::from(SIDE);
        texels.chunks_exact(2).map(side).collect()
    }
}

fn plain(gpu: &Gpu) -> MapTechnique {
    let map = MapConfig { size: MAP, ..MapConfig::default() };
    MapTechnique::plain(gpu, &map).expect("a valid config")
}

fn cascades(gpu: &Gpu, count: u32, fit: CascadeFit) -> MapTechnique {
    let config = Cascades {
        of: (),
        count,
        splits: Splits::Logarithmic,
        select: Select::Depth,
        blend: 0.0,
        fit,
    };
    plain(gpu).rearranged(|others| config.arrange(others)).expect("valid settings")
}

fn overhead() -> Light {
    Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.0 }
}

/// Of the map with the matrix `clip`, the share of its side that a slice takes, along s and t.
fn filled(clip: &DMat4, near: f64, far: f64) -> DVec2 {
    let corners = [near, far].into_iter().flat_map(|z| {
        [-1.0, 1.0].map(|x| clip.project_point3(DVec3::new(x * TAN_HALF * z, 0.0, -z)))
    });
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (lo, hi) = corners.fold(none, |(lo, hi), p| (lo.min(p), hi.max(p)));
    0.5 * (hi - lo).truncate()
}

/// Depths a slice.
const DEPTHS: usize = 64;

/// Texels a pixel: the largest errors along s and t, over the slices' own samples, multiplied and added up; for maps
/// whose guard band and steps are taken off. And how near every error is to the curve of the theory.
fn storage(gpu: &Gpu, far: f64, count: u32, fit: CascadeFit, warped: bool) -> f64 {
    let ends = Splits::Logarithmic.ends(1.0, far, count);
    // A little within a slice, which the fit pads by 1e-4 of its far end, so that it is that slice's.
    let depth = |pair: &[f64], k: usize| {
        let (near, far) = (pair[0] * (1.0 + 3e-4), pair[1] * (1.0 - 3e-4));
        near * (far / near).powf(k as f64 / (DEPTHS - 1) as f64)
    };
    let depths: Vec<f64> =
        ends.windows(2).flat_map(|pair| (0..DEPTHS).map(|k| depth(pair, k))).collect();
    let samples: Vec<ViewSample> =
        depths.iter().map(|z| sample(-DVec3::Z * *z, DVec3::Y)).collect();
    let view = View::new(gpu, far, &samples);
    let mut technique = cascades(gpu, count, fit);
    let (layout, views) = view.fitted(gpu, &mut technique, &overhead());
    let mut pass = SamplingError::new(gpu, layout).expect("linked");
    let sides = view.sides(gpu, &mut pass, &views);
    let guard = 1.0 - 2.0 * f64::from(technique.map().guard()) / f64::from(MAP);
    let mut texels = 0.0;
    for (i, pair) in ends.windows(2).enumerate() {
        let clip = views[i].clip.expect("a map a slice");
        let filled = filled(&clip, pair[0], pair[1]);
        // Not larger than it takes: a step of 2^(1/8), and a texel for the grid; or the guard band alone.
        let least = if warped { 1.0 } else { (1.0 - 2.0 / f64::from(MAP)) * 2f64.powf(-0.125) };
        let off = (filled / (guard * least)).min_element();
        assert!(off > 0.995, "{fit:?}, slice {i} of {count}: {filled} of the map filled");
        // s runs along the view for a map that is not warped, else across.
        let along_first = clip.row(0).z.abs() > clip.row(0).x.abs();
        let turned = |v: DVec2| if along_first { v.yx() } else { v };
        let part = ViewFrustum { tan_half: TAN_HALF, aspect: 1.0, near: pair[0], far: pair[1] };
        let map = if warped { part.best_warp() } else { Parametrisation::Uniform };
        let mut most = DVec2::ZERO;
        for k in 0..DEPTHS {
            let (z, sides) = (depths[DEPTHS * i + k], sides[DEPTHS * i + k]);
            let found = turned(sides * filled);
            let expected = part.perspective_error(map, z, 1.0);
            let off = (found / expected - 1.0).abs().max_element();
            assert!(off < 0.01, "{fit:?}, slice {i} of {count} at {z} m: {found}, not {expected}");
            most = most.max(found);
        }
        texels += most.x * most.y;
    }
    texels
}

#[test]
fn built_maps_need_the_texels_of_the_closed_forms() {
    let gpu = gpu();
    for (far, count, uniform, warped) in [
        (100.0, 1, 9_900.0, 99.0),
        (100.0, 4, 27.3509, 8.64911),
        (1000.0, 1, 999_000.0, 999.0),
        (1000.0, 2, 1936.75, 61.2456),
        (1000.0, 4, 103.997, 18.4937),
        (1000.0, 8, 26.0163, 10.9710),
    ] {
        for (fit, expected) in [(CascadeFit::Tight, uniform), (CascadeFit::Warped, warped)] {
            let found = storage(&gpu, far, count, fit, fit == CascadeFit::Warped);
            // Samples keep 3e-4 of their depth off the slices' ends; the visible region is padded by 2^-20 of the scene,
            // which is 1e-3 of the near end's depth. Depths enter with powers of up to 3.
            let off = (found / expected - 1.0).abs();
            assert!(off < 0.01, "{count} to {far} m, {fit:?}: {found}, not {expected}");
        }
    }
}

/// The optimum, ln(far / near) / (2 tan) texels a pixel, has no projection; slices that are warped approach it.
#[test]
fn more_slices_approach_the_logarithmic_optimum() {
    let gpu = gpu();
    let view = ViewFrustum { tan_half: TAN_HALF, aspect: 1.0, near: 1.0, far: 1000.0 };
    let optimum = view.storage_factor(Parametrisation::Logarithmic, 1.0).texels();
    assert!((optimum - 6.90776).abs() < 1e-5, "{optimum}");
    let found = [2, 4, 8].map(|count| storage(&gpu, 1000.0, count, CascadeFit::Warped, true));
    assert!(found.windows(2).all(|p| p[1] < p[0]) && found[2] > optimum, "{found:?}");
    assert!(found[2] < 1.6 * optimum, "{found:?}");
}

/// Points of all of the view's faces, and of its axis.
fn faces(far: f64, to_light: DVec3) -> Vec<ViewSample> {
    let mut samples = Vec::new();
    for k in 0..24 {
        let z = far.powf(f64::from(k) / 23.0).clamp(1.0 + 1e-4, far * (1.0 - 1e-4));
        for (i, j) in (-2..=2).flat_map(|i| (-2..=2).map(move |j| (i, j))) {
            let tan = DVec2::new(i.into(), j.into()) * (0.5 * 0.999 * TAN_HALF);
            samples.push(sample(tan.extend(-1.0) * z, to_light));
        }
    }
    samples
}

#[test]
fn a_warp_needs_no_more_texels_than_none_at_any_tilt_and_depth() {
    let gpu = gpu();
    let mut warp = plain(&gpu)
        .rearranged(|others| Lispsm::<()>::default().arrange(others))
        .expect("valid settings");
    let mut none = plain(&gpu);
    let mut pass = SamplingError::new(&gpu, Layout::single()).expect("linked");
    let tilts = [90.0, 60.0, 30.0, 20.0, 10.0, 5.0, 0.5, 0.01, 0.0];
    let mut gained = 0.0_f64;
    for far in [10.0, 100.0, 1000.0, 10_000.0] {
        for tilt in tilts.iter().flat_map(|t| [*t, 180.0 - t]) {
            let (sin, cos) = f64::to_radians(tilt).sin_cos();
            let direction = DVec3::new(0.0, -sin, -cos);
            let light = Light::Directional { direction, angular_diameter: 0.0 };
            let view = View::new(&gpu, far, &faces(far, -direction));
            let mut texels = |technique: &mut MapTechnique| {
                let (layout, views) = view.fitted(&gpu, technique, &light);
                assert_eq!(layout, Layout::single(), "one map");
                let sides = view.sides(&gpu, &mut pass, &views);
                assert!(sides.iter().all(|s| s.is_finite()), "{tilt} degrees to {far}");
                let most = sides.iter().fold(DVec2::ZERO, |most, s| most.max(*s));
                most.x * most.y
            };
            let (with, without) = (texels(&mut warp), texels(&mut none));
            assert!(without > 0.0, "{tilt} degrees to {far}: nothing is looked up");
            assert!(
                with <= 1.01 * without,
                "{tilt} degrees to {} m: {with} texels a pixel warped, {without} not",
                view.far
            );
            if tilt == 90.0 {
                gained = gained.max(without / with);
            }
        }
    }
    // far / near times, for the largest of them.
    assert!(gained > 5000.0, "{gained} times fewer texels");
}

/// A wall half a degree from edge-on to the light: texels are 1 / sin 0.5 degrees times as long on it, whatever the map.
#[test]
fn projection_error_is_that_of_the_wall_under_any_map() {
    let gpu = gpu();
    let (sin, cos) = 0.5_f64.to_radians().sin_cos();
    let to_light = DVec3::new(0.0, cos, sin);
    let light = Light::Directional { direction: -to_light, angular_diameter: 0.0 };
    let p = DVec3::new(0.0, 0.0, -20.0);
    let wall = ViewSample { position: p.as_vec3(), normal: glam::Vec3::Z };
    let view = View::new(&gpu, 100.0, &[sample(p, to_light), wall]);
    let lispsm = plain(&gpu)
        .rearranged(|others| Lispsm::<()>::default().arrange(others))
        .expect("valid settings");
    let all = [
        plain(&gpu),
        lispsm,
        cascades(&gpu, 4, CascadeFit::Tight),
        cascades(&gpu, 4, CascadeFit::Warped),
        cascades(&gpu, 4, CascadeFit::Steady),
    ];
    for (number, mut technique) in all.into_iter().enumerate() {
        let (layout, views) = view.fitted(&gpu, &mut technique, &light);
        let mut pass = SamplingError::new(&gpu, layout).expect("linked");
        let sides = view.sides(&gpu, &mut pass, &views);
        let stretch = sides[1].max_element() / sides[0].y.max(sides[0].x);
        // Of the sides one runs up the wall; of the other surface's, across the view, one may be the longer.
        let along = (sides[1] / sides[0]).max_element();
        assert!(
            (along * sin - 1.0).abs() < 1e-3 && stretch <= along * 1.001,
            "map {number}: {along} times, not {}",
            1.0 / sin
        );
    }
}
