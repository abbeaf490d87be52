//! Lights that are brighter here than there: closed forms behind a half-plane, and traced truth.

use crate::shared::area;

use antumbra::Config;
use antumbra_gpu::Gpu;
use antumbra_map::{Bias, MapConfig};
use antumbra_measure::Stage;
use antumbra_reference::{TruthOptions, ViewSample};
use antumbra_scene::{Emission, Light, Scene, generate};
use antumbra_soft::{Bitmask, Samples, Window};
use antumbra_tests::gpu;
use area::{along_a_floor, bodies, lights, map, seen, shoot};
use glam::{DAffine3, DVec3, Vec3};

fn emission(columns: u32, rows: u32, values: &[f64]) -> Emission {
    Emission::new(columns, rows, values).expect("a valid image")
}

/// Dark to the left, along the light's first side, or dark to the right, or below or above.
fn halves() -> [Emission; 4] {
    [(2, 1, [0.0, 1.0]), (2, 1, [1.0, 0.0]), (1, 2, [0.0, 1.0]), (1, 2, [1.0, 0.0])]
        .map(|(columns, rows, values)| emission(columns, rows, &values))
}

/// Every texel by itself, of a fine map.
fn shining(samples: Samples, emission: Option<Emission>) -> Config {
    let bias = Bias { cone: 0.0, ..Bias::default() };
    let map = MapConfig { bias, ..map(2048) };
    let window = Window { budget: 128, ..Window::default() };
    Config::Bitmask(Bitmask { map, window, samples, emission, ..Bitmask::default() })
}

#[test]
fn behind_a_half_plane_each_half_of_the_light_is_seen_by_itself() {
    let gpu = gpu();
    // x < 0 at half the depth: hides what lies to the left of -x, of a light from -1 to 1.
    let sheet = [(-50.0, 0.0, 5.0)];
    let places: [(Samples, &[f64]); 3] = [
        (Samples::S64, &[0.0]),
        (Samples::S256, &[-0.5, 0.0, 0.25, 0.5]),
        (Samples::S1024, &[0.0]),
    ];
    for (samples, places) in places {
        let at = |emission| along_a_floor(&gpu, &sheet, places, &shining(samples, emission));
        let (halves, whole) = (halves().map(|half| at(Some(half))), at(None));
        for (i, &x) in places.iter().enumerate() {
            let [right, left, above, below] = [0, 1, 2, 3].map(|half| f64::from(halves[half][i]));
            let whole = f64::from(whole[i]);
            let seen =
                |from: f64, to: f64| ((to - f64::max(from, -x)) / (to - from)).clamp(0.0, 1.0);
            // A view reaches to a slope of 1.4; texels are 2 of the light's metres a metre at the depth 5, and half of the light
            // is 1 m; columns of samples lie a 32nd to a 128th of 2 m apart.
            let texel = 2.0 * 1.4 / 2044.0 * 10.0;
            let off = texel + 1.0 / f64::from(2 * samples.tiles()) / 2.0;
            for (name, found, truth) in [
                ("whole", whole, seen(-1.0, 1.0)),
                ("right", right, seen(0.0, 1.0)),
                ("left", left, seen(-1.0, 0.0)),
                ("above", above, seen(-1.0, 1.0)),
                ("below", below, seen(-1.0, 1.0)),
            ] {
                let what = format!("{name} at {x} by {samples:?}");
                assert!((found - truth).abs() <= off, "{what}: {found}, not {truth} +- {off}");
            }
            // Two halves are the whole, sample by sample.
            for halves in [left + right, above + below] {
                assert!((0.5 * halves - whole).abs() < 1e-6, "{halves} of {whole} at {x}");
            }
        }
    }
}

/// Points of a floor below a sheet and a ball, neither of which touches it.
fn floating(gpu: &Gpu) -> Stage {
    const SIDE: i32 = 48;
    let mut scene = Scene { name: "floating".to_owned(), ..Scene::default() };
    scene.add(generate::shapes::floor(3.0), DAffine3::IDENTITY);
    let ball = generate::shapes::icosphere(3, 0.4);
    scene.add(ball, DAffine3::from_translation(DVec3::new(1.0, 1.5, 0.5)));
    let sheet = generate::shapes::quad(DVec3::new(0.0, 2.0, 0.0), DVec3::X * 0.6, DVec3::Z * 0.4);
    scene.add(sheet, DAffine3::IDENTITY);
    let place = |i: i32| (f64::from(i) + 0.5) * 5.0 / f64::from(SIDE) - 2.5;
    let origin = scene.origin();
    let samples: Vec<ViewSample> = (0..SIDE * SIDE)
        .map(|i| DVec3::new(place(i % SIDE), 0.0, place(i / SIDE)) - origin)
        .map(|p| ViewSample { position: p.as_vec3(), normal: Vec3::Y })
        .collect();
    Stage::at_points(gpu, &scene, &samples).expect("a stage")
}

/// Root of the mean square error of two lists where the truth of the light as a whole is a penumbra.
fn error(found: &[f32], truth: &[f32], whole: &[f32]) -> f64 {
    let all =
        found.iter().zip(truth).zip(whole).filter(|(_, whole)| **whole > 0.0 && **whole < 1.0);
    let squares: Vec<f64> = all.map(|((a, b), _)| f64::from(a - b).powi(2)).collect();
    assert!(squares.len() > 300, "{} samples in the penumbra", squares.len());
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn images_on_lights_agree_with_traced_truth_and_their_mirror_images_do_not() {
    let gpu = gpu();
    let stage = floating(&gpu);
    let options = TruthOptions { light_samples: 1024, ..TruthOptions::default() };
    // Unlike each of its mirror images, and itself turned by a quarter.
    let image = emission(2, 2, &[0.0, 1.0, 0.25, 4.0]);
    let others = [[1.0, 0.0, 4.0, 0.25], [0.25, 4.0, 0.0, 1.0], [0.25, 0.0, 4.0, 1.0]]
        .map(|values| emission(2, 2, &values));
    // Two rectangles, of which one is tilted, and a disc.
    for light in &lights(0.6)[2..] {
        let shot = |emission| shoot(&gpu, &stage, light, &shining(Samples::S256, emission));
        let truth = |of: Option<&Emission>| stage.truth_of(light, of, &options).visibility;
        let whole = truth(None);
        assert_eq!(whole, stage.truth(light, &options).visibility, "a light without an image");
        let plain = error(&shot(None), &whole, &whole);
        let found = shot(Some(image.clone()));
        let pictured = error(&found, &truth(Some(&image)), &whole);
        // At worst all of the error lies in the brightest quarter, 4 / 5.25 of all that is emitted.
        let most = 4.0 * 4.0 / 5.25;
        assert!(plain < 0.02, "{plain} under {light:?}");
        assert!(pictured < most * plain, "with an image {pictured}, without {plain}, {light:?}");
        for of in &others {
            let wrong = error(&found, &truth(Some(of)), &whole);
            assert!(wrong > 4.0 * pictured, "mirrored {wrong}, {pictured} under {light:?}");
        }
        // Alike everywhere is as if there were none.
        let even = shot(Some(emission(3, 2, &[7.0; 6])));
        assert!(error(&even, &shot(None), &whole) < 1e-6, "an even image under {light:?}");
    }
}

#[test]
fn images_on_a_sphere_and_on_a_sun_are_refused() {
    let gpu = gpu();
    let stage = seen(&gpu, &bodies(), 8);
    let config = shining(Samples::S64, Some(halves()[0].clone()));
    let mut technique = config.build(&gpu).expect("a valid config");
    for light in lights(0.3) {
        let found = stage.shoot(&gpu, &light, technique.as_mut(), 0);
        let is_flat = matches!(light, Light::Rect { .. } | Light::Disc { .. });
        let error = found.err().map(|error| error.to_string()).unwrap_or_default();
        assert_eq!(error.contains("use a rectangle or a disc"), !is_flat, "{light:?}: `{error}`");
    }
}
