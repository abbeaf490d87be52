//! Raw float images: float32 EXR files, losslessly compressed (ZIP), one channel `Y` or `RGBA`.

use std::path::Path;

use ::exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes,
    ReadChannels as _, ReadLayers as _, WritableImage as _, read,
};
use anyhow::{Context as _, bail, ensure};

/// An image of `N` floats per pixel, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FloatImage<const N: usize> {
    /// Pixels per row.
    pub(crate) width: usize,
    /// Rows.
    pub(crate) height: usize,
    /// `width * height` pixels.
    pub(crate) pixels: Vec<[f32; N]>,
}

/// Channel names by number of channels.
fn names(channels: usize) -> anyhow::Result<&'static [&'static str]> {
    match channels {
        1 => Ok(&["Y"]),
        4 => Ok(&["R", "G", "B", "A"]),
        n => bail!("float images have 1 or 4 channels, not {n}"),
    }
}

impl<const N: usize> FloatImage<N> {
    /// An image from its pixels.
    pub(crate) fn new(width: usize, height: usize, pixels: Vec<[f32; N]>) -> anyhow::Result<Self> {
        ensure!(width > 0 && height > 0, "an image of {width}x{height} pixels has no pixel");
        ensure!(
            pixels.len() == width * height,
            "an image of {width}x{height} pixels was given {} pixels",
            pixels.len()
        );
        Ok(Self { width, height, pixels })
    }

    /// Writes the image, all 32 bits of every float.
    pub(crate) fn write(&self, path: &Path) -> anyhow::Result<()> {
        let channels = names(N)?.iter().enumerate().map(|(i, &name)| {
            let values = self.pixels.iter().map(|p| p[i]).collect();
            AnyChannel::new(name, FlatSamples::F32(values))
        });
        let layer = Layer::new(
            (self.width, self.height),
            LayerAttributes::default(),
            Encoding::SMALL_LOSSLESS,
            AnyChannels::sort(channels.collect()),
        );
        Image::from_layer(layer)
            .write()
            .to_file(path)
            .with_context(|| format!("cannot write {}", path.display()))
    }

    /// Reads an image with the same channels. A missing file, a missing channel or one that is not
    /// float32 is an error that names the file.
    pub(crate) fn read(path: &Path) -> anyhow::Result<Self> {
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_file(path)
            .with_context(|| format!("cannot read {}", path.display()))?;
        let layer = image.layer_data;
        let (width, height) = (layer.size.width(), layer.size.height());
        let mut pixels = vec![[0.0; N]; width * height];
        for (i, &name) in names(N)?.iter().enumerate() {
            let Some(channel) = layer.channel_data.list.iter().find(|c| c.name.eq(name)) else {
                bail!("{} has no channel {name}", path.display());
            };
            let FlatSamples::F32(values) = &channel.sample_data else {
                bail!("channel {name} of {} is not float32", path.display());
            };
            ensure!(values.len() == pixels.len(), "{} is cut short", path.display());
            for (pixel, &value) in pixels.iter_mut().zip(values) {
                pixel[i] = value;
            }
        }
        Self::new(width, height, pixels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bits that a lossy or half-float encoding would change.
    const AWKWARD: [f32; 6] = [0.1, -1e-38, 1e30, 1.000_000_1, f32::MIN_POSITIVE, -0.0];

    #[test]
    fn one_channel_comes_back_bit_for_bit() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let path = dir.path().join("y.exr");
        let pixels: Vec<[f32; 1]> = (0..35).map(|i| [AWKWARD[i % 6] * (i as f32 + 0.5)]).collect();
        let image = FloatImage::new(7, 5, pixels).expect("sizes fit");
        image.write(&path).expect("written");
        let back = FloatImage::<1>::read(&path).expect("read");
        let bits = |i: &FloatImage<1>| i.pixels.iter().map(|p| p[0].to_bits()).collect::<Vec<_>>();
        assert_eq!((back.width, back.height), (7, 5), "size");
        assert_eq!(bits(&back), bits(&image), "lossless");
    }

    #[test]
    fn four_channels_keep_their_order() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let path = dir.path().join("rgba.exr");
        let pixels = vec![[1.5, -2.5, 1e6, 1.0], [0.25, 0.1, -3.0, 0.0]];
        let image = FloatImage::new(1, 2, pixels).expect("sizes fit");
        image.write(&path).expect("written");
        assert_eq!(FloatImage::<4>::read(&path).expect("read"), image, "RGBA stays RGBA");
    }

    #[test]
    fn faults_name_the_file() {
        let dir = tempfile::tempdir().expect("temporary directory");
        let missing = dir.path().join("missing.exr");
        let error = FloatImage::<1>::read(&missing).expect_err("no such file");
        assert!(format!("{error:#}").contains("missing.exr"), "{error:#}");

        let corrupt = dir.path().join("corrupt.exr");
        std::fs::write(&corrupt, b"v/1\x01 not really").expect("written");
        let error = FloatImage::<1>::read(&corrupt).expect_err("no image");
        assert!(format!("{error:#}").contains("corrupt.exr"), "{error:#}");

        let rgba = dir.path().join("rgba.exr");
        let image = FloatImage::new(1, 1, vec![[1.0; 4]]).expect("sizes fit");
        image.write(&rgba).expect("written");
        let error = FloatImage::<1>::read(&rgba).expect_err("no channel Y");
        assert!(format!("{error:#}").contains("no channel Y"), "{error:#}");
        assert!(FloatImage::new(2, 2, vec![[0.0; 1]; 3]).is_err(), "three pixels for 2x2");
    }
}
