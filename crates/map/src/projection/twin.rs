//! The projections' shader functions in f64: their truth in tests.

/// `darkness` of `map/disc.wesl`: how dark a disc of `radius` metres and `opacity`, full within the share `inner` of
/// the radius, is at `distance` metres from its centre.
#[must_use]
pub fn darkness(distance: f64, radius: f64, opacity: f64, inner: f64) -> f64 {
    let t = ((distance / radius - inner) / (1.0 - inner)).clamp(0.0, 1.0);
    opacity * (1.0 - t * t * (3.0 - 2.0 * t))
}

/// Normalised weights of the blur of `map/mask_blur.wesl` with the standard deviation `sigma` texels, from the first
/// tap to the last.
#[must_use]
pub fn blur_weights(sigma: f64) -> Vec<f64> {
    let radius = (3.0 * sigma).ceil() as i32;
    let weights: Vec<f64> =
        (-radius..=radius).map(|i| (-0.5 * (f64::from(i) / sigma).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| w / sum).collect()
}
