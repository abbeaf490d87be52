//! Occlusion textures: exact behind one plate, their twin behind two, what fusion and slicing lose, and their cost.

use crate::shared::area;

use antumbra::Config;
use antumbra_filter::PcfGrid;
use antumbra_gpu::{Gpu, TechniqueConfig as _, ViewCamera};
use antumbra_map::Plain;
use antumbra_measure::Stage;
use antumbra_reference::{SampleClass, TruthOptions, ViewSample};
use antumbra_scene::{Camera, Light, LightKind, Scene, generate};
use antumbra_soft::twin::occlusion::{Slices, planes};
use antumbra_soft::{Fusion, OcclusionTextures, Placement, Prefilter};
use antumbra_tests::gpu;
use area::{along_a_floor, below_a_square_light, bodies, lights, map, plate, seen, shoot, shots};
use glam::{DAffine3, DVec2, DVec3};

fn textures(size: u32) -> OcclusionTextures {
    OcclusionTextures { map: map(size), ..OcclusionTextures::default() }
}

#[test]
fn behind_one_plate_the_answer_is_the_closed_form() {
    let gpu = gpu();
    let center = DVec3::new(0.0, 4.0, 0.0);
    let (x, z) = (DVec3::X, DVec3::Z);
    for light in [
        Light::Rect { center, half_u: x * 0.5, half_v: z * 0.3 },
        Light::Disc { center, radius: 0.5, axis_u: x, axis_v: z },
        Light::Sphere { center, radius: 0.5 },
        Light::Directional { direction: DVec3::NEG_Y, angular_diameter: 0.3 },
    ] {
        let plate = plate(&gpu, light, 1.6);
        for config in [
            textures(256),
            textures(512),
            textures(1024),
            OcclusionTextures { slices: 6, placement: Placement::Error, ..textures(512) },
            OcclusionTextures { offset: false, fusion: Fusion::Max, ..textures(512) },
        ] {
            let (rmse, width) = plate.errors(&gpu, &Config::OcclusionTextures(config));
            assert!(rmse <= 0.01, "{config:?} under {light:?}: RMSE {rmse}");
            assert!(width.abs() <= 0.03, "{config:?} under {light:?}: width off by {width}");
        }
        // The control: a kernel that does not know how wide the penumbra is.
        let fixed = Config::PcfGrid(PcfGrid { map: map(512), side: 7 });
        let (rmse, _) = plate.errors(&gpu, &fixed);
        assert!(rmse > 0.05, "a fixed kernel under {light:?}: RMSE {rmse}");
    }
}

#[test]
fn slices_that_hide_the_same_or_the_rest_are_put_together_as_each_rule_says() {
    let gpu = gpu();
    let same = [(-50.0, 0.0, 4.0), (-50.0, 0.0, 6.0)];
    let opposite = [(-50.0, 0.0, 4.0), (0.0, 50.0, 6.0)];
    // Seen from the axis edges on it stay there as they are flattened. A window of 200 texels of a sheet 100 m wide holds
    // its edge to a texel of 512: 1 / 40 of the light's width of 2 m, seen at half the distance.
    for (fusion, expected) in [(Fusion::Product, 0.25), (Fusion::Sum, 0.0), (Fusion::Max, 0.5)] {
        let config = OcclusionTextures { fusion, slices: 16, ..textures(2048) };
        for sheets in [&same, &opposite] {
            let found = below_a_square_light(&gpu, sheets, 0.0, &Config::OcclusionTextures(config));
            assert!((found - expected).abs() < 0.04, "{fusion:?}: {found}, not {expected}");
        }
    }
    // What the light's centre does not see counts, too: 0.75 for every technique over one map, and 0 by areas.
    let hidden = [(-0.2, 0.2, 2.0), (-0.35, 0.35, 8.0)];
    let config = OcclusionTextures { fusion: Fusion::Sum, slices: 16, ..textures(512) };
    let found = below_a_square_light(&gpu, &hidden, 0.0, &Config::OcclusionTextures(config));
    assert!(found < 0.1, "the hidden strip hides all: {found}");
}

/// Two square plates at 4 and 6 m below a rectangle of light, and points on a floor at 10 m.
fn two_plates(gpu: &Gpu) -> (Stage, Vec<DVec3>) {
    let mut scene = Scene { name: "two plates".to_owned(), ..Scene::default() };
    let floor = generate::shapes::quad(DVec3::Y * -10.0, DVec3::Z * 8.0, DVec3::X * 8.0);
    scene.add(floor, DAffine3::IDENTITY);
    for (x, z, depth) in PLATES {
        let plate = generate::shapes::quad(DVec3::new(x, -depth, z), DVec3::Z, DVec3::X);
        scene.add(plate, DAffine3::IDENTITY);
    }
    let points: Vec<DVec3> = (0..400)
        .map(|i| {
            let (x, z) = (f64::from(i % 20), f64::from(i / 20));
            DVec3::new(-4.0 + 0.41 * x, -10.0, -4.0 + 0.39 * z)
        })
        .collect();
    let origin = scene.origin();
    let samples: Vec<ViewSample> = points
        .iter()
        .map(|p| ViewSample { position: (*p - origin).as_vec3(), normal: glam::Vec3::Y })
        .collect();
    (Stage::at_points(gpu, &scene, &samples).expect("a stage"), points)
}

/// Middle in x and z and depth of plates of half side 1.
const PLATES: [(f64, f64, f64); 2] = [(0.3, -0.2, 4.0), (-0.8, 0.6, 6.0)];

#[test]
fn the_shader_is_its_twin_behind_two_plates() {
    let gpu = gpu();
    let (stage, points) = two_plates(&gpu);
    let (hu, hv) = (0.8, 0.5);
    let light = Light::Rect { center: DVec3::ZERO, half_u: DVec3::X * hu, half_v: DVec3::Z * hv };
    let mut lit = 0;
    for fusion in [Fusion::Product, Fusion::Sum, Fusion::Max] {
        for (offset, fade) in [(true, 1.0), (false, 0.3)] {
            let config = OcclusionTextures { fusion, offset, fade, slices: 5, ..textures(1024) };
            let found = shoot(&gpu, &stage, &light, &Config::OcclusionTextures(config));
            // As the store has them: to a little behind the farther plate.
            let near = 4.0;
            let planes =
                planes((near, near + 2.0 * (1.0 + 1e-4)), 10.0, 5, Placement::Uniform, &[], false);
            // As far off as h (z + d) / d is the half side of what the plates fill: at most 1.8 at 6 m.
            let stand_off = if offset {
                let by = |h: f64, e: f64| if e > h { (h * 6.0 / (e - h)).min(24.0) } else { 24.0 };
                by(hu, 1.8).min(by(hv, 1.6))
            } else {
                0.0
            };
            let covered = |k: usize, center: DVec2, half: DVec2| {
                let from = if k == 0 { near - 0.1 } else { planes[k - 1] };
                let of = |(x, z, depth): &(f64, f64, f64)| {
                    if *depth <= from || *depth > planes[k] {
                        return 0.0;
                    }
                    let onto = (planes[k] + stand_off) / (depth + stand_off);
                    let side = |m: f64, c: f64, h: f64| {
                        let (lo, hi) = ((m - 1.0) * onto, (m + 1.0) * onto);
                        (hi.min(c + h) - lo.max(c - h)).max(0.0) / (2.0 * h)
                    };
                    side(*x, center.x, half.x) * side(*z, center.y, half.y)
                };
                PLATES.iter().map(of).sum::<f64>()
            };
            let slices = Slices {
                planes: &planes,
                near,
                half: DVec2::new(hu, hv),
                parallel: false,
                fade: f64::from(fade),
                fusion,
                covered: &covered,
            };
            let mut worst: f64 = 0.0;
            for (found, p) in found.iter().zip(&points) {
                let exact = slices.visibility(DVec3::new(p.x, p.z, 10.0));
                worst = worst.max((f64::from(*found) - exact).abs());
                lit += usize::from(exact == 1.0);
            }
            // Plates and their windows span less than 5 m at 6 m, of which the image is 1024 texels, 0.005 m; windows are
            // at least 2 hv (10 - 6) / 10 = 0.4 m wide. An edge is half a texel off and each plate has two sides an axis.
            assert!(worst < 4.0 * 0.5 * 0.005 / 0.4, "{fusion:?}, {offset}: off by {worst}");
        }
    }
    assert!(lit > 100 && lit < 6 * 390, "{lit} points are lit");
}

/// A sheet of no thickness from (-1, 4) to (1, 6), endless across, as x and depth below a square light.
fn tilted_sheet(gpu: &Gpu, config: OcclusionTextures) -> Vec<f32> {
    let mut scene = Scene { name: "sheet".to_owned(), ..Scene::default() };
    let floor = generate::shapes::quad(DVec3::Y * -10.0, DVec3::Z * 60.0, DVec3::X * 60.0);
    scene.add(floor, DAffine3::IDENTITY);
    let along = DVec3::new(1.0, -1.0, 0.0);
    let sheet = generate::shapes::quad(DVec3::Y * -5.0, DVec3::Z * 5.0, along);
    scene.add(sheet, DAffine3::IDENTITY);
    let origin = scene.origin();
    let samples: Vec<ViewSample> = (0..200)
        .map(|i| {
            let p = DVec3::new(-1.0 + 0.01 * f64::from(i), -10.0, 0.0);
            ViewSample { position: (p - origin).as_vec3(), normal: glam::Vec3::Y }
        })
        .collect();
    let stage = Stage::at_points(gpu, &scene, &samples).expect("a stage");
    let light = Light::Rect { center: DVec3::ZERO, half_u: DVec3::X, half_v: DVec3::Z };
    shoot(gpu, &stage, &light, &Config::OcclusionTextures(config))
}

#[test]
fn light_leaks_between_slices_and_the_successor_closes_the_gaps() {
    let gpu = gpu();
    // From x in [-1, 1] the sheet hides the light between (-10 - 4 x) / 6 and (10 - 6 x) / 4, so all of it.
    let umbra = |found: &[f32]| found[30..170].iter().copied().fold(0.0, f32::max);
    let product = OcclusionTextures { fade: 0.0, ..textures(512) };
    let open = umbra(&tilted_sheet(&gpu, product));
    let closed = umbra(&tilted_sheet(&gpu, OcclusionTextures { successor: true, ..product }));
    let sum = umbra(&tilted_sheet(&gpu, OcclusionTextures { fusion: Fusion::Sum, ..product }));
    // Slices that share the light have a product of at least (1 - 1/8)^8 = 0.34 where each hides an eighth.
    assert!(open > 0.2, "{open}");
    assert!(closed < 0.6 * open, "{closed}, and {open} without");
    assert!(sum < 0.1, "{sum}");
}

#[test]
fn more_slices_bring_a_plate_between_planes_nearer_to_the_truth() {
    let gpu = gpu();
    // Alone a plate has slices of its own thickness: so it is the shadow of the upper plate of two that counts here, seen
    // where the lower one hides nothing.
    let sheets = [(-8.0, 0.0, 5.0), (40.0, 44.0, 8.0)];
    let error = |slices, placement| {
        let config = OcclusionTextures { slices, placement, ..textures(2048) };
        let places = [-0.6, 0.0, 0.6];
        let found = along_a_floor(&gpu, &sheets, &places, &Config::OcclusionTextures(config));
        let off = found.iter().zip(places).map(|(v, x)| (f64::from(*v) - (0.5 + 0.5 * x)).abs());
        off.fold(0.0, f64::max)
    };
    let errors = [2, 4, 16].map(|n| error(n, Placement::Uniform));
    // The error falls with a slice's thickness.
    assert!(errors[2] < 0.5 * errors[0] && errors[1] < errors[0], "{errors:?}");
}

#[test]
fn work_is_the_same_whatever_the_lights_side() {
    let gpu = gpu();
    let stage = seen(&gpu, &bodies(), 64);
    let rect = |half: f64| Light::Rect {
        center: DVec3::new(0.4, 5.0, -0.3),
        half_u: DVec3::X * half,
        half_v: DVec3::Z * half,
    };
    let all = [0.1, 0.4, 1.6].map(rect);
    let pairs = all.iter().map(|light| (&stage, light));
    let found = shots(&gpu, &Config::OcclusionTextures(textures(128)), pairs);
    for (visibility, counters) in &found {
        assert!(visibility.iter().any(|v| *v > 0.0 && *v < 1.0), "a penumbra");
        for name in ["fetches", "map_passes", "map_texels", "store_texels"] {
            assert_eq!(counters[name], found[0].1[name], "{name}");
        }
    }
    assert_eq!(found[0].1["fetches"], 64 * 64 * 16 * 8);
}

#[test]
fn a_light_without_an_extent_gives_the_plain_maps_bits() {
    let gpu = gpu();
    let stage = seen(&gpu, &bodies(), 64);
    let point = Light::Point { position: DVec3::new(0.4, 5.0, -0.3) };
    let all: Vec<Light> = lights(0.0).into_iter().chain([point]).collect();
    let pairs = || all.iter().map(|light| (&stage, light));
    let plain = shots(&gpu, &Config::Plain(Plain { map: map(128) }), pairs());
    let found = shots(&gpu, &Config::OcclusionTextures(textures(128)), pairs());
    for ((found, plain), light) in found.iter().zip(&plain).zip(&all) {
        assert_eq!(found.0, plain.0, "under {light:?}");
        assert_eq!(found.1["map_triangles"], plain.1["map_triangles"], "under {light:?}");
    }
}

#[test]
fn lights_of_any_size_give_numbers_from_0_to_1() {
    let gpu = gpu();
    let mut scene = bodies();
    // A sheet that touches the light.
    let at_light = generate::shapes::quad(DVec3::new(0.4, 5.0, -0.3), DVec3::X * 0.1, DVec3::Z);
    scene.add(at_light, DAffine3::IDENTITY);
    let stage = seen(&gpu, &scene, 32);
    let mut all: Vec<Light> = [1e-7, 1e-3, 0.3, 4.0, 100.0].into_iter().flat_map(lights).collect();
    all.sort_by_key(|light| light.position().is_none());
    for placement in [Placement::Uniform, Placement::Error] {
        let config = OcclusionTextures { placement, ..textures(64) };
        let pairs = all.iter().map(|light| (&stage, light));
        for ((found, _), light) in
            shots(&gpu, &Config::OcclusionTextures(config), pairs).iter().zip(&all)
        {
            let wrong = found.iter().find(|v| !(0.0..=1.0).contains(*v));
            assert_eq!(wrong, None, "{placement:?} under {light:?}");
        }
    }
}

#[test]
fn tables_are_exact_n_buffers_nearly_and_mipmaps_less() {
    let gpu = gpu();
    let light = Light::Rect {
        center: DVec3::new(0.0, 4.0, 0.0),
        half_u: DVec3::X * 0.5,
        half_v: DVec3::Z * 0.3,
    };
    let plate = plate(&gpu, light, 1.6);
    let [table, n_buffer, mip] =
        [Prefilter::Table, Prefilter::NBuffer, Prefilter::Mip].map(|prefilter| {
            let config = OcclusionTextures { prefilter, ..textures(256) };
            plate.errors(&gpu, &Config::OcclusionTextures(config)).0
        });
    assert!(table < n_buffer && n_buffer < mip, "{table} {n_buffer} {mip}");
    // Between powers of two a box is the sum of two, of which one is up to half too small and the other up to twice too
    // large: a ramp of twice the width differs from the ramp by a quarter at most, and on this line by half that at most.
    assert!(n_buffer < 0.125 && mip < 0.25, "{n_buffer} {mip}");
}

#[test]
fn slices_before_what_is_seen_keep_the_shadows_of_a_deep_scene() {
    let gpu = gpu();
    let scene = generate::street();
    let stage = seen(&gpu, &scene, 64);
    let light = scene.light_or_placed(LightKind::Rect);
    let truth = stage.truth(&light, &TruthOptions { light_samples: 64, ..Default::default() });
    let error = |placement| {
        let config = OcclusionTextures { placement, ..textures(512) };
        let found = shoot(&gpu, &stage, &light, &Config::OcclusionTextures(config));
        let all = found.iter().zip(&truth.visibility).zip(&truth.class);
        let counted = all.filter(|(_, class)| **class == SampleClass::Counted);
        let squares: Vec<f64> = counted.map(|((a, b), _)| f64::from(a - b).powi(2)).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    // Equal slices, which are thicker than the houses are high, leave most of what is seen in the slice of its own caster.
    let (seen, uniform) = (error(Placement::Seen), error(Placement::Uniform));
    assert!(uniform > 0.3, "equal slices are off by {uniform} only");
    assert!(seen < 0.25 * uniform, "off by {seen}, equal slices by {uniform}");
}

#[test]
fn empty_windows_and_hidden_lights_are_skipped_and_no_answer_changes() {
    let gpu = gpu();
    let stage = seen(&gpu, &bodies(), 64);
    let all = lights(0.3);
    let found = [true, false].map(|skip| {
        let config = OcclusionTextures { skip, tally: true, ..textures(128) };
        shots(&gpu, &Config::OcclusionTextures(config), all.iter().map(|light| (&stage, light)))
    });
    for ((skipping, looking), light) in found[0].iter().zip(&found[1]).zip(&all) {
        assert_eq!(skipping.0, looking.0, "under {light:?}");
        assert!(looking.0.iter().any(|v| *v < 0.5), "something is dark under {light:?}");
        let [skipped, looked_up] =
            ["windows_skipped", "windows_looked_up"].map(|name| skipping.1[name]);
        assert_eq!(looking.1["windows_skipped"], 0, "under {light:?}");
        assert_eq!(skipped + looked_up, looking.1["windows_looked_up"], "under {light:?}");
        // Of a window that is looked up the 4 fetches are in vain; of one that is not they spare 12 or more.
        assert!(12 * skipped > 4 * looked_up, "{skipped} of {looked_up} under {light:?}");
    }
}

/// Root of the mean square error over the counted samples, and of the mean square of what changes in them from one frame to the
/// next, while the camera goes along the street by `metres` a frame and samples and light stay what they are.
fn creeping(gpu: &Gpu, config: OcclusionTextures, metres: f64) -> (f64, f64) {
    let scene = generate::street();
    let mut stage = seen(gpu, &scene, 64);
    let light = scene.light_or_placed(LightKind::Rect);
    let truth = stage.truth(&light, &TruthOptions { light_samples: 64, ..Default::default() });
    let start = scene.camera_or_framing();
    let along = (start.target - start.eye).normalize();
    let mut technique = config.build(gpu).expect("a valid config");
    let mut before: Option<Vec<f32>> = None;
    let (mut errors, mut changes, mut count) = (0.0, 0.0, 0);
    for frame in 0..FRAMES {
        let step = along * metres * f64::from(frame);
        let camera = Camera { eye: start.eye + step, target: start.target + step, ..start };
        let clip = camera.view_projection(scene.origin(), 1.0);
        stage.set_camera(Some(ViewCamera { clip, eye: camera.eye - scene.origin() }));
        let found = stage.shoot(gpu, &light, technique.as_mut(), 0).expect("a shot").visibility;
        let counted = (0..found.len()).filter(|i| truth.class[*i] == SampleClass::Counted);
        for i in counted {
            errors += f64::from(found[i] - truth.visibility[i]).powi(2);
            changes +=
                before.as_ref().map_or(0.0, |before| f64::from(found[i] - before[i]).powi(2));
            count += 1;
        }
        before = Some(found);
    }
    let count = f64::from(count);
    let frames = f64::from(FRAMES);
    ((errors / count).sqrt(), (changes / count * frames / (frames - 1.0)).sqrt())
}

const FRAMES: u32 = 16;

#[test]
fn what_slices_err_changes_less_from_frame_to_frame_than_it_is() {
    let gpu = gpu();
    for placement in [Placement::Seen, Placement::Error, Placement::Uniform] {
        let config = OcclusionTextures { placement, ..textures(256) };
        let (error, fast) = creeping(&gpu, config, 0.5);
        // Errors that have nothing to do with each other change by the root of two of themselves from frame to frame; by
        // less than themselves, more than half of them (squared) stay.
        assert!(fast < error, "{placement:?}: off by {error}, changes by {fast}");
        let (_, slow) = creeping(&gpu, config, 0.5 / 16.0);
        // What jumps does so as often as it comes across something: a sixteenth as often. What moves along moves a sixteenth.
        assert!(slow < 0.25 * fast, "{placement:?}: {fast} at half a metre a frame, {slow}");
    }
    let config = textures(256);
    assert_eq!(creeping(&gpu, config, 0.0).1, 0.0, "nothing moves");
}
