//! Materials with alpha (section 3.9.4: `alphaMode` MASK and BLEND), read from the raw JSON.
//!
//! Whatever is wrong with a material leaves its meshes whole, and is counted: a scene without its textures still casts
//! shadows.

use std::collections::HashMap;
use std::io::Cursor;
use std::sync::Arc;

use glam::Vec2;
use serde_json::Value;

use super::accessor::Accessors;
use crate::{AlphaMap, Cutout, Opacity, Wrap};

/// What a material says of its surface's alpha.
#[derive(Clone, Debug)]
pub(super) struct Mask {
    /// Alpha of the base colour's factor, >= 0.
    factor: f32,
    /// Least alpha of what is there; `None` for a material that lets light through.
    cutoff: Option<f32>,
    texture: Option<Texture>,
}

#[derive(Clone, Debug)]
struct Texture {
    /// Where the image's bytes are.
    image: Image,
    /// Number of the texture coordinates' set.
    set: u32,
    wrap: [Wrap; 2],
    nearest: bool,
    /// `KHR_texture_transform`: offset, rotation in radians, scale.
    transform: (Vec2, f32, Vec2),
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Image {
    Uri(String),
    View(usize),
}

impl Mask {
    /// The mask of a material, or `None` for one of another mode. `Err` where it cannot be understood.
    fn of(root: &Value, material: usize) -> Result<Option<Self>, ()> {
        let material = root["materials"].get(material).ok_or(())?;
        let blends = match material["alphaMode"].as_str() {
            Some("MASK") => false,
            Some("BLEND") => true,
            _ => return Ok(None),
        };
        let number = |value: &Value, default: f64| match value {
            Value::Null => Ok(default as f32),
            value => value.as_f64().map(|n| n as f32).filter(|n| n.is_finite()).ok_or(()),
        };
        let color = &material["pbrMetallicRoughness"];
        Ok(Some(Self {
            factor: number(&color["baseColorFactor"][3], 1.0)?.max(0.0),
            cutoff: if blends { None } else { Some(number(&material["alphaCutoff"], 0.5)?) },
            texture: match &color["baseColorTexture"] {
                Value::Null => None,
                texture => Some(Texture::of(root, texture).ok_or(())?),
            },
        }))
    }

    /// The attribute that holds its texture coordinates.
    fn attribute(&self) -> Option<String> {
        self.texture.as_ref().map(|texture| format!("TEXCOORD_{}", texture.set))
    }

    /// The number of the set of its texture coordinates.
    pub(super) fn set(&self) -> Option<u32> {
        self.texture.as_ref().map(|texture| texture.set)
    }
}

impl Texture {
    fn of(root: &Value, info: &Value) -> Option<Self> {
        let texture = root["textures"].get(usize::try_from(info["index"].as_u64()?).ok()?)?;
        let image = root["images"].get(usize::try_from(texture["source"].as_u64()?).ok()?)?;
        let image = match (image["uri"].as_str(), image["bufferView"].as_u64()) {
            (Some(uri), _) => Image::Uri(uri.to_owned()),
            (None, Some(view)) => Image::View(usize::try_from(view).ok()?),
            (None, None) => return None,
        };
        let sampler = match texture["sampler"].as_u64() {
            Some(sampler) => root["samplers"].get(usize::try_from(sampler).ok()?)?,
            None => &Value::Null,
        };
        // The numbers are those of OpenGL (section 5.26).
        let wrap = |key: &str| match sampler[key].as_u64() {
            Some(33071) => Wrap::Clamp,
            Some(33648) => Wrap::Mirror,
            _ => Wrap::Repeat,
        };
        let moved = &info["extensions"]["KHR_texture_transform"];
        let pair = |value: &Value, default: f32| match value {
            Value::Null => Some(Vec2::splat(default)),
            value => Some(Vec2::new(value[0].as_f64()? as f32, value[1].as_f64()? as f32)),
        };
        let set = moved["texCoord"].as_u64().or(info["texCoord"].as_u64()).unwrap_or(0);
        Some(Self {
            image,
            set: u32::try_from(set).ok()?,
            wrap: [wrap("wrapS"), wrap("wrapT")],
            nearest: sampler["magFilter"].as_u64() == Some(9728),
            transform: (
                pair(&moved["offset"], 0.0)?,
                moved["rotation"].as_f64().unwrap_or(0.0) as f32,
                pair(&moved["scale"], 1.0)?,
            ),
        })
    }

    /// `KHR_texture_transform`: scaled, turned, moved.
    fn place(&self, uv: Vec2) -> Vec2 {
        let (offset, rotation, scale) = self.transform;
        let (sin, cos) = rotation.sin_cos();
        let uv = uv * scale;
        Vec2::new(cos * uv.x + sin * uv.y, cos * uv.y - sin * uv.x) + offset
    }
}

/// What a material's alpha makes of a mesh.
#[derive(Debug)]
pub(super) enum Surface {
    Whole,
    Cut(Cutout),
    Translucent(Opacity),
}

/// The materials with alpha of a file's primitives, and their textures once they were needed.
#[derive(Debug, Default)]
pub(super) struct Masks {
    of: HashMap<(usize, usize), Mask>,
    maps: HashMap<(Image, [u8; 2], bool), Arc<AlphaMap>>,
    /// Primitives whose material cannot be understood.
    pub(super) faulty: usize,
}

impl Masks {
    /// Reads the materials of all primitives.
    pub(super) fn new(root: &Value) -> Self {
        let mut masks = Self::default();
        for (mesh, object) in root["meshes"].as_array().into_iter().flatten().enumerate() {
            let primitives = object["primitives"].as_array().into_iter().flatten();
            for (number, primitive) in primitives.enumerate() {
                let Some(material) = primitive["material"].as_u64() else { continue };
                match usize::try_from(material).map_err(|_| ()).and_then(|m| Mask::of(root, m)) {
                    Ok(None) => {}
                    Ok(Some(mask)) => {
                        masks.of.insert((mesh, number), mask);
                    }
                    Err(()) => masks.faulty += 1,
                }
            }
        }
        masks
    }

    /// The mask of a primitive.
    pub(super) fn of(&self, mesh: usize, primitive: usize) -> Option<&Mask> {
        self.of.get(&(mesh, primitive))
    }

    /// Whether the primitive's attribute of that name holds its mask's texture coordinates.
    pub(super) fn reads(&self, mesh: usize, primitive: usize, attribute: &str) -> bool {
        self.of(mesh, primitive).and_then(Mask::attribute).is_some_and(|name| name == attribute)
    }

    /// What `mask` makes of a mesh whose vertices have these texture coordinates. `Err` where its texture cannot be
    /// read.
    pub(super) fn surface(
        &mut self,
        mask: &Mask,
        uv: &[Vec2],
        accessors: &mut Accessors<'_>,
    ) -> Result<Surface, String> {
        let alpha = match &mask.texture {
            None => {
                Arc::new(AlphaMap { width: 1, height: 1, texels: vec![255], ..AlphaMap::default() })
            }
            Some(texture) => {
                let key = (texture.image.clone(), texture.wrap.map(|w| w as u8), texture.nearest);
                match self.maps.get(&key) {
                    Some(known) => known.clone(),
                    None => {
                        let bytes = match &texture.image {
                            Image::Uri(uri) => accessors.file(uri)?,
                            Image::View(view) => accessors.view(*view)?,
                        };
                        let made = Arc::new(decode(&bytes, texture.wrap, texture.nearest)?);
                        self.maps.insert(key, made.clone());
                        made
                    }
                }
            }
        };
        // Alpha is the factor's times the texture's.
        let all_reach = |least: f32| alpha.texels.iter().all(|&a| f32::from(a) >= least);
        let place = |&uv: &Vec2| mask.texture.as_ref().map_or(uv, |texture| texture.place(uv));
        let uv = uv.iter().map(place).collect();
        let Some(cutoff) = mask.cutoff else {
            let whole = all_reach(255.0 / mask.factor);
            let opacity = Opacity { uv, alpha, factor: mask.factor };
            return Ok(if whole { Surface::Whole } else { Surface::Translucent(opacity) });
        };
        // Of a factor of zero, no texel reaches a cutoff above zero.
        let cutoff = if cutoff <= 0.0 { 0.0 } else { (255.0 * cutoff / mask.factor).min(256.0) };
        let cut = if all_reach(cutoff) { None } else { Some(Cutout { uv, alpha, cutoff }) };
        Ok(cut.map_or(Surface::Whole, Surface::Cut))
    }
}

/// The alpha of an image.
fn decode(bytes: &[u8], wrap: [Wrap; 2], nearest: bool) -> Result<AlphaMap, String> {
    let mut reader = image::ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|e| e.to_string())?;
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(AlphaMap::LARGEST);
    limits.max_image_height = Some(AlphaMap::LARGEST);
    reader.limits(limits);
    let image = reader.decode().map_err(|e| e.to_string())?.into_rgba8();
    let (width, height) = image.dimensions();
    let texels = image.pixels().map(|p| p.0[3]).collect();
    Ok(AlphaMap { width, height, texels, wrap, nearest })
}
