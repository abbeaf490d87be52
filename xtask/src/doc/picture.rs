//! The picture of a page: the scene under each technique, and the signed error below.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use clap::ValueEnum as _;
use image::RgbImage;

use super::mark::Mark;
use crate::args::{BenchArgs, Suite};
use crate::results::Results;
use crate::{bench, report};

/// Where the picture of a page lies.
pub(super) fn path(docs: &Path, page: &Path) -> PathBuf {
    docs.join("images").join(page.file_stem().unwrap_or_default()).with_extension("png")
}

/// The lines that show a picture which is there.
pub(super) fn caption(mark: &Mark<'_>, path: &Path) -> anyhow::Result<String> {
    let what = Asked::by(mark)?;
    ensure!(path.is_file(), "nobody drew {}; run `cargo xtask doc --draw`", path.display());
    let techniques: Vec<_> = what.techniques.iter().map(|name| format!("`{name}`")).collect();
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    Ok(format!(
        "\n![{scene} under a {light} light; {}](../images/{name})\n\n*{scene}, {light} light, {map}² texels. From left to right \
         {}. Below, the signed error: red is too light, blue too dark, grey does not count.*\n\n",
        what.techniques.join(", "),
        techniques.join(", "),
        scene = what.scene,
        light = what.light,
        map = what.map,
    ))
}

/// What a mark asks for.
struct Asked<'a> {
    scene: &'a str,
    light: &'a str,
    techniques: Vec<&'a str>,
    size: &'a str,
    map: u32,
}

impl<'a> Asked<'a> {
    fn by(mark: &Mark<'a>) -> anyhow::Result<Self> {
        mark.knows(&["scene", "light", "technique", "size", "map"])?;
        let need = |key: &'static str| mark.get(key).with_context(|| format!("names no {key}"));
        let map = mark.get("map").map(str::parse).transpose().context("`map` is no number")?;
        Ok(Self {
            scene: need("scene")?,
            light: need("light")?,
            techniques: need("technique")?.split(',').collect(),
            size: mark.get("size").unwrap_or("192x192"),
            map: map.unwrap_or(512),
        })
    }
}

/// Measures what the mark asks for, and draws it.
pub(super) fn draw(mark: &Mark<'_>, path: &Path) -> anyhow::Result<()> {
    let what = Asked::by(mark)?;
    let out = std::env::temp_dir().join(format!("antumbra-draw-{}", std::process::id()));
    let light = antumbra_scene::LightKind::ALL.into_iter().find(|kind| kind.name() == what.light);
    bench::run(BenchArgs {
        scene: vec![what.scene.to_owned()],
        light: vec![light.with_context(|| format!("unknown light `{}`", what.light))?],
        technique: what.techniques.iter().map(|name| (*name).to_owned()).collect(),
        size: Some(what.size.parse().map_err(anyhow::Error::msg)?),
        map_size: Some(what.map),
        repeat: Some(1),
        suite: Suite::from_str("full", false).map_err(anyhow::Error::msg)?,
        out: out.clone(),
        ..Default::default()
    })?;
    let results = Results::read(&out.join("results.json"))?;
    let runs = what.techniques.iter().map(|name| {
        let run = results.runs.iter().find(|run| run.technique == *name);
        run.with_context(|| format!("{name} was not measured"))
    });
    let sheet = report::sheet(&out, &runs.collect::<anyhow::Result<Vec<_>>>()?)?;
    // What is left behind in a temporary directory does no harm.
    let _ = std::fs::remove_dir_all(&out);
    let png = indexed(&sheet)?;
    std::fs::write(path, png).with_context(|| format!("cannot write {}", path.display()))
}

/// The picture as a PNG with a palette, a third as large as one of bytes: six bits a channel are enough for a page, or
/// five where six are more than 256 colours.
fn indexed(picture: &RgbImage) -> anyhow::Result<Vec<u8>> {
    let with_bits = |bits: u8| {
        let coarse = |c: u8| c >> (8 - bits) << (8 - bits) | c >> bits;
        let colours = picture.pixels().map(|pixel| pixel.0.map(coarse));
        let palette = BTreeSet::from_iter(colours.clone());
        (palette.len() <= 256)
            .then(|| (palette.into_iter().collect::<Vec<_>>(), colours.collect::<Vec<_>>()))
    };
    let (palette, colours) =
        [6, 5, 4].into_iter().find_map(with_bits).context("more than 256 colours")?;
    let index = |colour| palette.binary_search(colour).unwrap_or_default() as u8;
    let indices: Vec<u8> = colours.iter().map(index).collect();
    let mut png = Vec::new();
    let mut encoder = png::Encoder::new(&mut png, picture.width(), picture.height());
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_palette(palette.concat());
    encoder.set_compression(png::Compression::High);
    encoder.write_header()?.write_image_data(&indices)?;
    Ok(png)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_palette_keeps_six_bits_a_channel_and_white() {
        let picture = RgbImage::from_fn(16, 16, |x, y| image::Rgb([(16 * x + y) as u8, 255, 0]));
        let png = indexed(&picture).expect("64 colours");
        let back = image::load_from_memory(&png).expect("a PNG").to_rgb8();
        assert_eq!(back.dimensions(), picture.dimensions());
        for (a, b) in picture.pixels().zip(back.pixels()) {
            assert!(a.0.iter().zip(b.0).all(|(a, b)| a.abs_diff(b) < 4), "{a:?} {b:?}");
            assert_eq!([b.0[1], b.0[2]], [255, 0], "ends of the scale stay");
        }
    }
}
