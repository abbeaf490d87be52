//! Alpha-tested materials of glTF files.

use std::io::Cursor;
use std::sync::Arc;

use antumbra_scene::{Cutout, Repairs, Scene, Wrap};
use glam::Vec2;

use crate::gltf::glb;
use crate::read_as;

/// A picture of 2 x 1: alpha 0 and 255.
fn png() -> Vec<u8> {
    let mut bytes = Vec::new();
    let picture = image::RgbaImage::from_raw(2, 1, vec![9, 9, 9, 0, 9, 9, 9, 255]);
    let picture = picture.expect("two pixels");
    picture.write_to(&mut Cursor::new(&mut bytes), image::ImageFormat::Png).expect("written");
    bytes
}

/// A square whose second and third corner lie at the same place as others but for their texture coordinates, with the
/// material and textures given.
fn square(material: &str, textures: &str) -> Vec<u8> {
    let corners = [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0]];
    let list = [0, 1, 2, 0, 2, 3].map(|i: usize| corners[i]);
    let uv = [[0.0_f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.5], [1.0, 1.0], [0.0, 1.0]];
    let mut bytes: Vec<u8> = list.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend(uv.iter().flatten().flat_map(|x| x.to_le_bytes()));
    let picture = png();
    bytes.extend(&picture);
    glb(
        &format!(
            r#"{{"asset": {{"version": "2.0"}}, "buffers": [{{"byteLength": {}}}],
            "bufferViews": [{{"buffer": 0, "byteLength": 72}},
                            {{"buffer": 0, "byteOffset": 72, "byteLength": 48}},
                            {{"buffer": 0, "byteOffset": 120, "byteLength": {}}}],
            "accessors": [
                {{"bufferView": 0, "componentType": 5126, "count": 6, "type": "VEC3"}},
                {{"bufferView": 1, "componentType": 5126, "count": 6, "type": "VEC2"}}],
            "images": [{{"bufferView": 2, "mimeType": "image/png"}}],
            "samplers": [{{"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}}],
            "textures": [{textures}], "materials": [{material}],
            "meshes": [{{"name": "square", "primitives": [{{"material": 0,
                "attributes": {{"POSITION": 0, "TEXCOORD_0": 1, "COLOR_0": 77}}}}]}}],
            "nodes": [{{"mesh": 0}}]}}"#,
            bytes.len(),
            picture.len()
        ),
        &bytes,
    )
}

fn load(material: &str, textures: &str) -> (Scene, Repairs) {
    read_as("leaf.glb", square(material, textures)).expect("a sound file")
}

fn cutout(material: &str) -> Option<Arc<Cutout>> {
    let (scene, repairs) = load(material, r#"{"source": 0, "sampler": 0}"#);
    assert!(repairs.is_empty(), "nothing to repair: {repairs}");
    scene.triangles(scene.origin()).expect("a scene that holds together");
    scene.cutouts.get(&0).cloned()
}

const TEXTURE: &str = r#""baseColorTexture": {"index": 0}"#;

#[test]
fn a_mask_cuts_its_mesh_by_the_alpha_of_its_base_colour() {
    let mask = format!(r#"{{"alphaMode": "MASK", "pbrMetallicRoughness": {{{TEXTURE}}}}}"#);
    let (scene, _) = load(&mask, r#"{"source": 0, "sampler": 0}"#);
    // Corners at one place with two texture coordinates stay two.
    assert_eq!(scene.meshes[0].positions.len(), 5, "corners");
    let found = cutout(&mask).expect("a cut-out");
    assert_eq!((found.alpha.width, found.alpha.height), (2, 1), "the picture's size");
    assert_eq!(found.alpha.texels, [0, 255], "the picture's alpha");
    assert_eq!(found.alpha.wrap, [Wrap::Clamp, Wrap::Mirror], "the sampler's wrapping");
    assert!(found.alpha.nearest, "the sampler's filter");
    assert_eq!(found.cutoff, 127.5, "the default cutoff");
    assert!(found.is_there(Vec2::new(0.75, 0.5)) && !found.is_there(Vec2::new(0.25, 0.5)), "half");
    let half = mask.replace(TEXTURE, &format!(r#"{TEXTURE}, "baseColorFactor": [1, 1, 1, 0.8]"#));
    let half = half.replace(r#""MASK","#, r#""MASK", "alphaCutoff": 0.4,"#);
    let cutoff = cutout(&half).expect("a cut-out").cutoff;
    assert!((cutoff - 127.5).abs() < 1e-4, "alpha times 0.8 reaches 0.4: {cutoff}");
}

#[test]
fn texture_coordinates_are_moved_as_the_material_says() {
    let moved = r#"{"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0,
        "extensions": {"KHR_texture_transform":
            {"offset": [0.5, 0.25], "rotation": 1.5707964, "scale": [2, 3]}}}}}"#;
    let uv = &cutout(moved).expect("a cut-out").uv;
    // (1, 1) is scaled to (2, 3), and turned by a quarter, counter-clockwise with v down, to (3, -2).
    assert!(uv.iter().any(|uv| uv.distance(Vec2::new(3.5, -1.75)) < 1e-5), "{uv:?}");
}

#[test]
fn what_is_whole_or_of_another_mode_has_no_cut_out() {
    for whole in [
        format!(r#"{{"alphaMode": "OPAQUE", "pbrMetallicRoughness": {{{TEXTURE}}}}}"#),
        r#"{"alphaMode": "BLEND"}"#.to_owned(),
        format!(
            r#"{{"alphaMode": "MASK", "alphaCutoff": 0, "pbrMetallicRoughness": {{{TEXTURE}}}}}"#
        ),
        r#"{"alphaMode": "MASK"}"#.to_owned(),
        "{}".to_owned(),
    ] {
        assert_eq!(cutout(&whole), None, "{whole}");
    }
    // A factor below the cutoff leaves nothing.
    let gone =
        r#"{"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0]}}"#;
    let gone = cutout(gone).expect("a cut-out");
    assert!(!gone.is_there(Vec2::splat(0.5)), "nothing is there");
}

#[test]
fn what_blends_lets_light_through() {
    let textures = r#"{"source": 0, "sampler": 0}"#;
    let blend = format!(
        r#"{{"alphaMode": "BLEND", "pbrMetallicRoughness":
            {{{TEXTURE}, "baseColorFactor": [1, 1, 1, 0.8]}}}}"#
    );
    let opacity = |material: &str| {
        let (scene, repairs) = load(material, textures);
        assert!(repairs.is_empty() && scene.cutouts.is_empty(), "{material}: {repairs}");
        let triangles = scene.triangles(scene.origin()).expect("a scene that holds together");
        let left = triangles.opaque().triangles.len();
        assert_eq!(left, if scene.opacities.is_empty() { 2 } else { 0 }, "{material}: hides");
        scene.opacities.get(&0).cloned()
    };
    let found = opacity(&blend).expect("an opacity");
    let at = |u| found.at(Vec2::new(u, 0.5));
    assert_eq!([at(0.25), at(0.75)], [0.0, 0.8], "the factor's part of the picture's alpha");
    let even =
        r#"{"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.25]}}"#;
    assert_eq!(opacity(even).expect("an opacity").at(Vec2::splat(0.3)), 0.25, "without a texture");
    // What keeps all of it is whole.
    assert_eq!(opacity(r#"{"alphaMode": "BLEND"}"#), None, "whole");
}

#[test]
fn a_mask_that_cannot_be_read_leaves_the_mesh_whole_and_is_counted() {
    let mask = format!(r#"{{"alphaMode": "MASK", "pbrMetallicRoughness": {{{TEXTURE}}}}}"#);
    let other_set = mask.replace(r#""index": 0"#, r#""index": 0, "texCoord": 3"#);
    let missing = mask.replace(r#""index": 0"#, r#""index": 5"#);
    let broken = mask.replace(r#""MASK","#, r#""MASK", "alphaCutoff": "half","#);
    for (material, texture) in [
        (other_set.as_str(), r#"{"source": 0}"#),
        (&missing, r#"{"source": 0}"#),
        (&broken, r#"{"source": 0}"#),
        (&mask, r#"{"source": 4}"#),
        (&mask, "{}"),
    ] {
        let (scene, repairs) = load(material, texture);
        assert!(scene.cutouts.is_empty(), "{material}: no cut-out");
        assert_eq!(repairs.opaque_materials, 1, "{material}");
        assert_eq!(scene.triangle_count(), 2, "{material}: the mesh is there");
    }
}

#[test]
fn a_picture_that_is_none_leaves_the_mesh_whole() {
    let mask = format!(r#"{{"alphaMode": "MASK", "pbrMetallicRoughness": {{{TEXTURE}}}}}"#);
    let mut bytes = square(&mask, r#"{"source": 0}"#);
    let start = bytes.windows(4).rposition(|w| w == b"\x89PNG").expect("the picture");
    bytes[start..start + 4].fill(b'?');
    let (scene, repairs) = read_as("leaf.glb", bytes).expect("a sound file");
    assert_eq!((scene.cutouts.len(), repairs.opaque_materials), (0, 1), "whole and counted");
}
