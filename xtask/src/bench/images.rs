//! Raw images for other tools, and a shaded picture for people and for FLIP.

use std::path::Path;

use antumbra_measure::Stage;
use antumbra_reference::SampleClass;
use antumbra_scene::Light;
use anyhow::Context as _;
use glam::{DVec2, DVec3, Vec3};

use crate::exr::FloatImage;

/// Writes one value a pixel as `PREFIX.WHAT.exr` and gives the path relative to `out`.
pub(super) fn write_scalar(
    stage: &Stage,
    out: &Path,
    prefix: &str,
    what: &str,
    values: &[f32],
) -> anyhow::Result<String> {
    write(stage, out, &format!("{prefix}.{what}.exr"), values.iter().map(|v| [*v]).collect())
}

/// Writes world positions; A = 1 where the sample exists and counts.
pub(super) fn write_positions(
    stage: &Stage,
    out: &Path,
    prefix: &str,
    classes: &[SampleClass],
) -> anyhow::Result<String> {
    let pixels = stage.image.positions.iter().zip(classes).map(|(p, class)| {
        let world = stage.triangles.origin + p.as_dvec3();
        let counts = if *class == SampleClass::Counted { 1.0 } else { 0.0 };
        [world.x as f32, world.y as f32, world.z as f32, counts]
    });
    write(stage, out, &format!("{prefix}.position.exr"), pixels.collect())
}

/// Writes geometric normals; A = 1 where there is a surface.
pub(super) fn write_normals(stage: &Stage, out: &Path, folder: &str) -> anyhow::Result<String> {
    let pixels = stage.image.normals.iter().map(|n| {
        let there = if *n == Vec3::ZERO { 0.0 } else { 1.0 };
        [n.x, n.y, n.z, there]
    });
    write(stage, out, &format!("{folder}/normal.exr"), pixels.collect())
}

fn write<const N: usize>(
    stage: &Stage,
    out: &Path,
    name: &str,
    pixels: Vec<[f32; N]>,
) -> anyhow::Result<String> {
    let image = FloatImage::new(stage.image.width as usize, stage.image.height as usize, pixels)?;
    image.write(&out.join(name))?;
    Ok(name.to_owned())
}

/// The scene in plain grey, Lambert under the light's centre with a constant ambient term, sRGB-encoded.
/// Brightness does not fall with distance, so that shadows show everywhere.
pub(super) fn shade(stage: &Stage, light: &Light, visibility: &[f32]) -> Vec<[f32; 3]> {
    /// Twice a reflectance of 0.45, so that lit parts are light.
    const ALBEDO: f64 = 0.45;
    /// Share of light that comes from everywhere: what a clear sky adds to the sun, a fifth.
    const AMBIENT: f64 = 0.2;
    let shaded = |(p, n, v): (&Vec3, &Vec3, &f32)| {
        if *n == Vec3::ZERO {
            return [srgb(AMBIENT); 3];
        }
        let world: DVec3 = stage.triangles.origin + p.as_dvec3();
        let to_light = light.towards(world, DVec2::splat(0.5)).normalize_or_zero();
        let mut lit = n.as_dvec3().dot(to_light).max(0.0) * f64::from(*v);
        if let Light::Spot { direction, outer_angle, .. } = light
            && direction.normalize().dot(-to_light) < outer_angle.cos()
        {
            lit = 0.0;
        }
        [srgb(2.0 * ALBEDO * (AMBIENT + (1.0 - AMBIENT) * lit)); 3]
    };
    let samples = stage.image.positions.iter().zip(&stage.image.normals).zip(visibility);
    samples.map(|((p, n), v)| shaded((p, n, v))).collect()
}

/// IEC 61966-2-1.
fn srgb(linear: f64) -> f32 {
    let c = linear.clamp(0.0, 1.0);
    (if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }) as f32
}

/// Mean FLIP between two shaded pictures.
pub(super) fn flip(shaded: &[[f32; 3]], truth: &[[f32; 3]], stage: &Stage) -> anyhow::Result<f64> {
    let width = stage.image.width as usize;
    let result =
        antumbra_reference::flip(truth, shaded, width, antumbra_reference::FLIP_PIXELS_PER_DEGREE)?;
    Ok(result.mean)
}

/// Writes a shaded picture as `PREFIX.shaded.png`.
pub(super) fn write_shaded(
    stage: &Stage,
    out: &Path,
    prefix: &str,
    shaded: &[[f32; 3]],
) -> anyhow::Result<String> {
    let name = format!("{prefix}.shaded.png");
    let path = out.join(&name);
    let bytes: Vec<u8> =
        shaded.iter().flatten().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8).collect();
    image::save_buffer(
        &path,
        &bytes,
        stage.image.width,
        stage.image.height,
        image::ExtendedColorType::Rgb8,
    )
    .with_context(|| format!("cannot write {}", path.display()))?;
    Ok(name)
}
