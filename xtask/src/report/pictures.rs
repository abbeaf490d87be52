//! Pictures for people from the raw float images: visibility in grey, the signed error in colour.

use std::collections::HashMap;
use std::path::Path;

use anyhow::{Context as _, ensure};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{Rgb, RgbImage};

use crate::exr::FloatImage;
use crate::results::{Files, Run};

/// Widest picture on the page, pixels; wider ones are averaged down.
const MAX_WIDTH: u32 = 640;

/// No view sample, or one that does not count, in a picture of visibility: no shade of grey.
pub(super) const NO_SAMPLE: [u8; 3] = [120, 140, 175];
/// The same in a map of the error, where white, blue and red have a meaning.
const EXCLUDED: [u8; 3] = [150, 150, 150];
/// A value that is not finite, in either.
const NOT_FINITE: [u8; 3] = [255, 0, 255];
/// Too light by 1: the red end of ColorBrewer's RdBu.
const LEAK: [u8; 3] = [178, 24, 43];
/// Too dark by 1: its blue end.
const OVER_SHADOW: [u8; 3] = [33, 102, 172];

/// The pictures of one run, as data URIs.
#[derive(Default)]
pub(super) struct Strip {
    pub(super) reference: Option<String>,
    pub(super) visibility: Option<String>,
    pub(super) error: Option<String>,
    pub(super) shaded: Option<String>,
}

/// Makes pictures from the files of runs, and keeps what several runs share.
pub(super) struct Pictures<'a> {
    dir: &'a Path,
    scalars: HashMap<String, FloatImage<1>>,
    counted: HashMap<String, Vec<bool>>,
    uris: HashMap<String, String>,
}

impl<'a> Pictures<'a> {
    pub(super) fn new(dir: &'a Path) -> Self {
        Self { dir, scalars: HashMap::new(), counted: HashMap::new(), uris: HashMap::new() }
    }

    /// The pictures that `files` allows.
    pub(super) fn strip(&mut self, files: &Files) -> anyhow::Result<Strip> {
        let mut strip = Strip::default();
        if let Some(path) = &files.position
            && !self.counted.contains_key(path)
        {
            let position = FloatImage::<4>::read(&self.dir.join(path))?;
            let counted = position.pixels.iter().map(|p| p[3] > 0.5).collect();
            self.counted.insert(path.clone(), counted);
        }
        let counted = files.position.as_ref().and_then(|path| self.counted.get(path));
        let visibility = files.visibility.as_ref().map(|p| self.read(p)).transpose()?;
        if let Some(path) = &files.reference {
            if !self.scalars.contains_key(path) {
                let truth = self.read(path)?;
                self.uris.insert(path.clone(), data_uri(&grey(&truth, counted)?)?);
                self.scalars.insert(path.clone(), truth);
            }
            strip.reference = self.uris.get(path).cloned();
            if let (Some(visibility), Some(truth)) = (&visibility, self.scalars.get(path)) {
                strip.error = Some(data_uri(&error_map(visibility, truth, counted)?)?);
            }
        }
        if let Some(visibility) = &visibility {
            strip.visibility = Some(data_uri(&grey(visibility, counted)?)?);
        }
        if let Some(path) = &files.shaded {
            let path = self.dir.join(path);
            let shaded =
                image::open(&path).with_context(|| format!("cannot read {}", path.display()))?;
            strip.shaded = Some(data_uri(&shaded.to_rgb8())?);
        }
        Ok(strip)
    }

    fn read(&self, path: &str) -> anyhow::Result<FloatImage<1>> {
        FloatImage::read(&self.dir.join(path))
    }
}

/// Runs side by side: the shaded scene, and below it the signed error.
pub(super) fn sheet(dir: &Path, runs: &[&Run]) -> anyhow::Result<RgbImage> {
    const GAP: u32 = 4;
    let mut pictures = Pictures::new(dir);
    let mut columns = Vec::new();
    for run in runs {
        let files = &run.files;
        let named = |file: &Option<String>| {
            file.clone().with_context(|| format!("{}: {}", run.technique, run.status))
        };
        pictures.strip(files)?;
        let counted = files.position.as_ref().and_then(|path| pictures.counted.get(path));
        let truth = pictures.read(&named(&files.reference)?)?;
        let error = error_map(&pictures.read(&named(&files.visibility)?)?, &truth, counted)?;
        let shaded = image::open(dir.join(named(&files.shaded)?))?.to_rgb8();
        columns.push([shaded, error]);
    }
    let [width, height] = columns.first().map_or([0; 2], |[first, _]| first.dimensions().into());
    let count = columns.len() as u32;
    let white = Rgb([255; 3]);
    let (all, tall) = (count * (width + GAP), 2 * height + GAP);
    let mut sheet = RgbImage::from_pixel(all.saturating_sub(GAP).max(1), tall, white);
    for (column, pair) in columns.iter().enumerate() {
        let x = i64::from(column as u32 * (width + GAP));
        for (row, picture) in pair.iter().enumerate() {
            image::imageops::replace(
                &mut sheet,
                picture,
                x,
                i64::from(row as u32 * (height + GAP)),
            );
        }
    }
    Ok(sheet)
}

/// Visibility, black = shadow.
fn grey(image: &FloatImage<1>, counted: Option<&Vec<bool>>) -> anyhow::Result<RgbImage> {
    picture(image.width, image.height, counted, NO_SAMPLE, |i| {
        let v = image.pixels[i][0];
        if v.is_finite() { [(v.clamp(0.0, 1.0) * 255.0).round() as u8; 3] } else { NOT_FINITE }
    })
}

/// Visibility minus truth: white = right, red = too light, blue = too dark.
fn error_map(
    visibility: &FloatImage<1>,
    truth: &FloatImage<1>,
    counted: Option<&Vec<bool>>,
) -> anyhow::Result<RgbImage> {
    ensure!(
        (visibility.width, visibility.height) == (truth.width, truth.height),
        "visibility has {}x{} samples, its reference {}x{}",
        visibility.width,
        visibility.height,
        truth.width,
        truth.height
    );
    picture(truth.width, truth.height, counted, EXCLUDED, |i| {
        error_colour(visibility.pixels[i][0] - truth.pixels[i][0])
    })
}

/// The colour of a signed error. Its strength goes with the square root, so that an error of 0.01
/// is still a tenth of the way from white.
fn error_colour(error: f32) -> [u8; 3] {
    if !error.is_finite() {
        return NOT_FINITE;
    }
    let end = if error > 0.0 { LEAK } else { OVER_SHADOW };
    let strength = error.abs().min(1.0).sqrt();
    end.map(|c| (255.0 + (f32::from(c) - 255.0) * strength).round() as u8)
}

fn picture(
    width: usize,
    height: usize,
    counted: Option<&Vec<bool>>,
    left_out: [u8; 3],
    colour: impl Fn(usize) -> [u8; 3],
) -> anyhow::Result<RgbImage> {
    if let Some(counted) = counted {
        ensure!(
            counted.len() == width * height,
            "the position image has {} samples, the visibility image {}",
            counted.len(),
            width * height
        );
    }
    Ok(RgbImage::from_fn(width as u32, height as u32, |x, y| {
        let i = y as usize * width + x as usize;
        Rgb(if counted.is_some_and(|c| !c[i]) { left_out } else { colour(i) })
    }))
}

/// The picture as a PNG data URI, averaged down to [`MAX_WIDTH`] if it is wider.
fn data_uri(picture: &RgbImage) -> anyhow::Result<String> {
    let (width, height) = picture.dimensions();
    let mut png = Vec::new();
    let encoder =
        PngEncoder::new_with_quality(&mut png, CompressionType::Best, FilterType::Adaptive);
    if width > MAX_WIDTH {
        let small_height = (height * MAX_WIDTH / width).max(1);
        image::imageops::thumbnail(picture, MAX_WIDTH, small_height).write_with_encoder(encoder)?;
    } else {
        picture.write_with_encoder(encoder)?;
    }
    Ok(format!("data:image/png;base64,{}", BASE64.encode(png)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_colours_point_the_right_way() {
        assert_eq!(error_colour(0.0), [255; 3], "right is white");
        let [r, _, b] = error_colour(0.5);
        assert!(r > b, "too light is red");
        let [r, _, b] = error_colour(-0.5);
        assert!(b > r, "too dark is blue");
        assert_eq!(error_colour(7.0), LEAK, "clamped at the end of the scale");
        assert_eq!(error_colour(f32::NAN), NOT_FINITE, "not a number stands out");
    }

    #[test]
    fn samples_that_do_not_count_are_grey_in_the_error_map() {
        let image = |v: f32| FloatImage::new(2, 1, vec![[v], [v]]).expect("sizes fit");
        let map = error_map(&image(1.0), &image(0.0), Some(&vec![true, false])).expect("same size");
        assert_eq!(map.get_pixel(0, 0).0, LEAK, "a counted sample shows its error");
        assert_eq!(map.get_pixel(1, 0).0, EXCLUDED, "an excluded one does not");
        let wide = FloatImage::new(3, 1, vec![[0.0]; 3]).expect("sizes fit");
        assert!(error_map(&wide, &image(0.0), None).is_err(), "sizes must agree");
    }
}
