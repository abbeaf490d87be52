//! Every error figure on hand-computed arrays, each with a control that must change it.

use antumbra_reference::SampleClass::{self, Counted, FacingAway, Missing, OutsideLight, Tie};
use antumbra_reference::{
    Comparison, MetricError, Metrics, contact_gap, penumbra_width, penumbra_width_error,
    temporal_error,
};

const ALL: [SampleClass; 512] = [Counted; 512];

fn compare(estimate: &[f32], reference: &[f32]) -> Metrics {
    let classes = &ALL[..estimate.len()];
    Comparison { estimate, reference, classes, width: estimate.len() }
        .metrics()
        .expect("valid arrays")
}

fn near(found: f64, expected: f64) -> bool {
    // Inputs are f32: half a unit of the last place of 1 is 6e-8, twice over.
    (found - expected).abs() <= 1.2e-7
}

#[test]
fn figures_match_hand_computed_values() {
    // e = 0.5, -0.25, 0, 0.
    let m = compare(&[0.5, 0.25, 1.0, 0.75], &[0.0, 0.5, 1.0, 0.75]);
    assert_eq!(m.view_samples, 4, "all four count");
    assert_eq!(m.mean_signed, 0.0625, "(0.5 - 0.25) / 4");
    assert_eq!(m.mean_abs, 0.1875, "(0.5 + 0.25) / 4");
    assert_eq!(m.rmse, (0.3125_f64 / 4.0).sqrt(), "root of (0.25 + 0.0625) / 4");
    assert_eq!(m.leak, 0.125, "0.5 / 4");
    assert_eq!(m.over_shadow, 0.0625, "0.25 / 4");
    assert_eq!((m.p95, m.p99, m.max), (0.5, 0.5, 0.5), "rank 4 of 4");
    assert_eq!(m.bad_fraction, 0.5, "two of four beyond 0.1");
    assert_eq!(m.penumbra_rmse, Some((0.0625_f64 / 2.0).sqrt()), "second and fourth sample");
    assert_eq!(m.flip, None, "filled elsewhere");
}

#[test]
fn identical_inputs_give_exactly_zero() {
    let v = [0.0, 0.1, 0.333, 0.9, 1.0];
    let m = compare(&v, &v);
    let figures = [m.mean_signed, m.mean_abs, m.rmse, m.leak, m.over_shadow, m.p95, m.p99, m.max];
    assert_eq!(figures, [0.0; 8], "no error anywhere");
    assert_eq!(m.bad_fraction, 0.0, "no sample is off");
    assert_eq!(m.penumbra_rmse, Some(0.0), "no error in the penumbra");
}

#[test]
fn swapping_estimate_and_reference_swaps_leak_and_over_shadow() {
    let (a, b) = ([0.1, 0.8, 0.4, 1.0], [0.3, 0.2, 0.4, 0.0]);
    let (m, s) = (compare(&a, &b), compare(&b, &a));
    assert_eq!((m.leak, m.over_shadow), (s.over_shadow, s.leak), "the two change places");
    assert_eq!((m.mean_signed, m.mean_abs), (-s.mean_signed, s.mean_abs), "sign turns, size stays");
    assert!(m.leak != m.over_shadow, "the example tells the two apart");
}

#[test]
fn percentiles_are_nearest_ranks() {
    // |e| = 0, 1/256, .., 199/256 in scrambled order (7 has no factor with 200).
    let estimate: Vec<f32> = (0..200).map(|i| ((i * 7) % 200) as f32 / 256.0).collect();
    let m = compare(&estimate, &[0.0; 200]);
    assert_eq!(m.p95, 189.0 / 256.0, "rank 190 of 200");
    assert_eq!(m.p99, 197.0 / 256.0, "rank 198 of 200");
    assert_eq!(m.max, 199.0 / 256.0, "rank 200 of 200");
}

#[test]
fn a_corrupted_estimate_raises_every_error_figure() {
    let reference: Vec<f32> = (0..100).map(|i| (i as f32 / 40.0).min(1.0)).collect();
    let clean = compare(&reference, &reference);
    let mut corrupted = reference.clone();
    for i in 0..10 {
        corrupted[i] = 1.0; // leak, in the penumbra
        corrupted[99 - i] = 0.0; // acne
    }
    let m = compare(&corrupted, &reference);
    let pairs = [
        (m.mean_abs, clean.mean_abs),
        (m.rmse, clean.rmse),
        (m.leak, clean.leak),
        (m.over_shadow, clean.over_shadow),
        (m.p95, clean.p95),
        (m.p99, clean.p99),
        (m.max, clean.max),
        (m.bad_fraction, clean.bad_fraction),
        (m.penumbra_rmse.unwrap_or(0.0), clean.penumbra_rmse.unwrap_or(0.0)),
        (m.acne_rate.unwrap_or(0.0), clean.acne_rate.unwrap_or(0.0)),
    ];
    for (i, (bad, good)) in pairs.into_iter().enumerate() {
        assert!(bad > good, "figure {i}: {bad} is not above {good}");
    }
}

#[test]
fn a_shifted_image_has_more_error_the_farther_it_is_shifted() {
    let edge = |shift: usize| -> Vec<f32> {
        (0..64).map(|i| if i % 64 < 20 + shift { 0.0 } else { 1.0 }).collect()
    };
    let errors: Vec<f64> = (0..5).map(|s| compare(&edge(s), &edge(0)).mean_abs).collect();
    assert!(errors.windows(2).all(|w| w[1] > w[0]), "not rising: {errors:?}");
    assert_eq!(errors[4], 4.0 / 64.0, "four samples of 64 change");
}

#[test]
fn only_counted_samples_enter() {
    let classes = [Counted, FacingAway, OutsideLight, Tie, Missing, Counted];
    let estimate = [0.5, 1.0, 1.0, 1.0, f32::NAN, 1.0];
    let reference = [0.0, f32::NAN, f32::NAN, 0.0, f32::NAN, 1.0];
    let c = Comparison { estimate: &estimate, reference: &reference, classes: &classes, width: 3 };
    let m = c.metrics().expect("faults only where nothing is read");
    assert_eq!(
        (m.view_samples, m.excluded_facing, m.outside_light, m.ties),
        (2, 1, 1, 1),
        "counts"
    );
    assert_eq!((m.max, m.leak), (0.5, 0.25), "the tie's error of 1 does not enter");
    // Control: counting the tie changes the result.
    let counted = [Counted, FacingAway, OutsideLight, Counted, Missing, Counted];
    let control = Comparison { classes: &counted, ..c }.metrics().expect("valid");
    assert_eq!(control.max, 1.0, "the former tie now counts");
}

#[test]
fn acne_is_sought_only_more_than_eight_pixels_from_shadow() {
    // 40 x 20, one shadowed pixel at (10, 10); acne at given pixels.
    let (width, height) = (40, 20);
    let mut reference = vec![1.0_f32; width * height];
    reference[10 * width + 10] = 0.0;
    let classes = vec![Counted; width * height];
    let rate = |x: usize, y: usize, value: f32| {
        let mut estimate = reference.clone();
        estimate[y * width + x] = value;
        Comparison { estimate: &estimate, reference: &reference, classes: &classes, width }
            .metrics()
            .expect("valid")
            .acne_rate
            .expect("there are lit samples")
    };
    // The square of 17 x 17 around the shadow is not looked at.
    let candidates = (width * height - 17 * 17) as f64;
    assert_eq!(rate(18, 18, 0.0), 0.0, "at distance 8");
    assert_eq!(rate(19, 18, 0.0), 1.0 / candidates, "at distance 9");
    assert_eq!(rate(1, 10, 0.0), 1.0 / candidates, "at distance 9 to the left");
    assert_eq!(rate(2, 2, 0.0), 0.0, "at distance 8 diagonally");
    assert_eq!(rate(19, 0, 0.89), 1.0 / candidates, "just below 0.9");
    assert_eq!(rate(19, 0, 0.9), 0.0, "0.9 itself passes");
    let dark = compare(&[0.0, 0.0], &[0.0, 0.0]);
    assert_eq!(dark.acne_rate, None, "no lit sample, no rate");
}

#[test]
fn no_penumbra_gives_null_and_not_zero() {
    let m = compare(&[0.5, 1.0], &[0.0, 1.0]);
    assert_eq!(m.penumbra_rmse, None, "no sample between 0 and 1");
}

#[test]
fn faulty_input_never_gives_a_number() {
    let good = [0.0_f32, 0.5, 1.0, 1.0];
    let c = Comparison { estimate: &good, reference: &good, classes: &ALL[..4], width: 2 };
    for value in [f32::NAN, f32::INFINITY, -0.001, 1.001] {
        let bad = [0.0, 0.5, value, 1.0];
        let found = Comparison { estimate: &bad, ..c }.metrics();
        let named = matches!(found, Err(MetricError::Estimate { index: 2, .. }));
        assert!(named, "estimate {value} gives {found:?}");
        let found = Comparison { reference: &bad, ..c }.metrics();
        let named = matches!(found, Err(MetricError::Reference { index: 2, .. }));
        assert!(named, "reference {value} gives {found:?}");
    }
    let short = Comparison { reference: &good[..3], ..c }.metrics();
    let expected = MetricError::LengthMismatch { what: "references", expected: 4, found: 3 };
    assert_eq!(short, Err(expected), "one reference too few");
    let short = Comparison { classes: &ALL[..5], ..c }.metrics();
    let expected = MetricError::LengthMismatch { what: "classes", expected: 4, found: 5 };
    assert_eq!(short, Err(expected), "one class too many");
    for width in [0, 3] {
        let found = Comparison { width, ..c }.metrics();
        assert_eq!(found, Err(MetricError::Width { samples: 4, width }), "rows do not fill");
    }
    let away = Comparison { classes: &[FacingAway; 4], ..c }.metrics();
    assert_eq!(away, Err(MetricError::Empty), "nothing counted");
    let nothing = Comparison { estimate: &[], reference: &[], classes: &[], width: 1 }.metrics();
    assert_eq!(nothing, Err(MetricError::Empty), "nothing at all");
}

#[test]
fn metrics_survive_serialisation_under_their_names() {
    // serde's own data model: the field names are those of the JSON output.
    let m = compare(&[0.5, 1.0], &[0.0, 1.0]);
    let text = format!("{m:?}");
    for name in [
        "view_samples",
        "excluded_facing",
        "ties",
        "mean_signed",
        "mean_abs",
        "rmse",
        "leak",
        "over_shadow",
        "p95",
        "p99",
        "max",
        "bad_fraction",
        "penumbra_rmse",
        "acne_rate",
        "flip",
    ] {
        assert!(text.contains(&format!("{name}: ")), "{name} is missing");
    }
}

#[test]
fn temporal_error_is_the_mean_change_of_error() {
    let reference = [0.0, 0.5, 1.0, 0.0];
    let frame = |estimate: &'static [f32; 4], classes: &'static [SampleClass; 4]| Comparison {
        estimate,
        reference: &[0.0, 0.5, 1.0, 0.0],
        classes,
        width: 4,
    };
    let all = &[Counted; 4];
    let a = frame(&[0.25, 0.5, 1.0, 0.0], all);
    assert_eq!(temporal_error(&a, &a), Ok(0.0), "nothing moves");
    let b = frame(&[0.0, 0.5, 0.5, 0.0], all);
    assert_eq!(temporal_error(&a, &b), Ok(0.1875), "(0.25 + 0.5) / 4");
    assert_eq!(temporal_error(&b, &a), Ok(0.1875), "symmetric");
    let partly = frame(&[0.0, 0.5, 0.5, 0.0], &[Counted, Counted, Tie, Counted]);
    assert!(near(temporal_error(&a, &partly).unwrap_or(9.0), 0.25 / 3.0), "the tie is left out");
    // A steady error, however large, does not flicker.
    let wrong = [1.0, 0.0, 0.0, 1.0];
    let steady = Comparison { estimate: &wrong, reference: &reference, classes: all, width: 4 };
    assert_eq!(temporal_error(&steady, &steady), Ok(0.0), "wrong but steady");
    let none = frame(&[0.0; 4], &[Tie; 4]);
    assert_eq!(temporal_error(&a, &none), Err(MetricError::Empty), "nothing counted in both");
    let small = Comparison { estimate: &[0.0], reference: &[0.0], classes: &[Counted], width: 1 };
    let mismatch = matches!(temporal_error(&a, &small), Err(MetricError::LengthMismatch { .. }));
    assert!(mismatch, "frames of different size");
}

#[test]
fn a_linear_penumbra_has_its_own_width() {
    let x: Vec<f64> = (0..=1000).map(|i| f64::from(i) * 0.01).collect();
    let ramp = |width: f64| -> Vec<f32> {
        x.iter().map(|x| ((x - 5.0) / width + 0.5).clamp(0.0, 1.0) as f32).collect()
    };
    let reversed: Vec<f32> = ramp(3.0).into_iter().rev().collect();
    for (width, profile) in [(3.0, ramp(3.0)), (2.0, ramp(2.0)), (3.0, reversed)] {
        let found = penumbra_width(&x, &profile).unwrap_or(f64::NAN);
        // Rounding to f32 moves a crossing by 6e-8 of the width at each end, at most.
        assert!((found - width).abs() < 1e-6, "{found} instead of {width}");
    }
    let error = penumbra_width_error(&x, &ramp(3.5), &ramp(3.0)).unwrap_or(f64::NAN);
    assert!((error - 0.5).abs() < 1e-6, "too wide by {error} instead of 0.5");
    let error = penumbra_width_error(&x, &ramp(2.0), &ramp(3.0)).unwrap_or(f64::NAN);
    assert!((error + 1.0).abs() < 1e-6, "too narrow by {error} instead of -1");
    assert_eq!(penumbra_width_error(&x, &ramp(3.0), &ramp(3.0)), Ok(0.0), "equal profiles");
    // A hard step between two positions spans 0.9 of their distance between the levels.
    let step: Vec<f32> = x.iter().map(|&x| if x < 5.0 { 0.0 } else { 1.0 }).collect();
    let found = penumbra_width(&x, &step).unwrap_or(f64::NAN);
    assert!((found - 0.01).abs() < 1e-9, "a step is as wide as one spacing, not {found}");
}

#[test]
fn a_profile_without_penumbra_or_out_of_order_is_refused() {
    let x = [0.0, 1.0, 2.0];
    let flat = penumbra_width(&x, &[1.0, 1.0, 1.0]);
    assert_eq!(flat, Err(MetricError::NoPenumbra { profile: "profile" }), "never dark");
    let half = penumbra_width_error(&x, &[0.0, 0.5, 0.9], &[0.0, 0.5, 1.0]);
    let expected = MetricError::NoPenumbra { profile: "estimated profile" };
    assert_eq!(half, Err(expected), "never fully lit");
    let order = penumbra_width(&[0.0, 2.0, 1.0], &[0.0, 0.5, 1.0]);
    assert_eq!(order, Err(MetricError::Position { index: 2 }), "goes back");
    let nan = penumbra_width(&[0.0, f64::NAN, 1.0], &[0.0, 0.5, 1.0]);
    assert_eq!(nan, Err(MetricError::Position { index: 1 }), "not a number");
    let value = penumbra_width(&x, &[0.0, 2.0, 1.0]);
    assert_eq!(value, Err(MetricError::Estimate { index: 1, value: 2.0 }), "no visibility");
    let length = penumbra_width(&x, &[0.0, 1.0]);
    assert!(matches!(length, Err(MetricError::LengthMismatch { .. })), "one value too few");
    assert_eq!(penumbra_width(&[], &[]), Err(MetricError::Empty), "empty");
}

#[test]
fn the_contact_gap_is_counted_in_texels() {
    let distances = [0.05, 0.15, 0.25, 0.35, 0.45];
    let dark = [0.0; 5];
    let gap = |estimate: [f32; 5]| contact_gap(&distances, &estimate, &dark, 0.1).unwrap_or(9.0);
    assert_eq!(gap([0.0; 5]), 0.0, "no gap");
    assert!((gap([1.0, 1.0, 0.0, 0.0, 0.0]) - 2.0).abs() < 1e-12, "two samples, two texels");
    assert!((gap([1.0; 5]) - 4.5).abs() < 1e-12, "as far as the line reaches");
    assert_eq!(gap([0.0, 0.0, 1.0, 1.0, 0.0]), 0.0, "a hole farther out is no contact gap");
    let truly_lit = contact_gap(&distances, &[1.0; 5], &[1.0; 5], 0.1);
    assert_eq!(truly_lit, Ok(0.0), "lit where the truth is lit");
    let texel = contact_gap(&distances, &dark, &dark, 0.0);
    assert_eq!(texel, Err(MetricError::Texel { size: 0.0 }), "no texel");
    let negative = contact_gap(&[-1.0, 1.0], &[0.0; 2], &[0.0; 2], 0.1);
    assert_eq!(negative, Err(MetricError::Position { index: 0 }), "behind the contact");
    let nan = contact_gap(&[0.0, 1.0], &[0.0; 2], &[0.0, f32::NAN], 0.1);
    assert!(matches!(nan, Err(MetricError::Reference { index: 1, .. })), "faulty truth: {nan:?}");
}
