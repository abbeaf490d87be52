//! Whatever the bytes, loading ends with a scene that holds what is promised, or with an error.

use antumbra_scene::{LoadError, REACH};
use glam::DVec3;
use proptest::prelude::*;

use crate::{Folder, gltf, obj, read, read_as};

/// One sound file of each format.
fn samples() -> [(&'static str, Vec<u8>); 4] {
    let nodes = r#"{"mesh": 0, "children": [1], "rotation": [0, 1, 0, 0]},
        {"mesh": 0, "scale": [2, 1, 1], "camera": 0}"#;
    let camera = r#", "scene": 0, "scenes": [{"nodes": [0]}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.2}}]"#;
    let glb = gltf::square(nodes, camera);
    let json = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    let data = "data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAACAPwAAAAAAAIA/\
                AAAAAAAAAAAAAIA/AAABAAIAAAACAAMA";
    let text = String::from_utf8_lossy(&glb[20..20 + json])
        .replace(r#""byteLength": 60"#, &format!(r#""byteLength": 60, "uri": "{data}""#));
    let toml = "name = \"x\"\n[[mesh]]\nfile = \"beside.obj\"\nscale = [1, 2, 1.5]\nrotate = [0, 45, 0]\n\
                [camera]\neye = [1, 2, 3]\ntarget = [0, 0, 0]\n[[light]]\nkind = \"sphere\"\n\
                center = [0, 9, 0]\nradius = 1.0\n[ground]\n";
    [
        ("a.glb", glb),
        ("a.gltf", text.into_bytes()),
        ("a.obj", obj::ROOF.as_bytes().to_vec()),
        ("a.toml", toml.as_bytes().to_vec()),
    ]
}

fn check(folder: &Folder, name: &str, bytes: &[u8]) {
    match read(&folder.write(name, bytes)) {
        Ok((scene, _)) => {
            let all = scene.triangles(scene.origin()).expect("loaded scenes are valid");
            assert!(!all.triangles.is_empty(), "{name}: a scene without triangles");
            let bounds = scene.subject_bounds();
            for corner in [bounds.min, bounds.max] {
                assert!(corner.abs().max_element() <= REACH, "{name}: {corner} is too far out");
            }
            for mesh in &scene.meshes {
                assert_eq!(mesh.validate(), Ok(()), "{name}: a faulty mesh");
            }
            let camera = scene.camera_or_framing();
            assert!(camera.view().is_finite(), "{name}: {camera:?}");
            let view = scene.framing_camera().view_projection(DVec3::ZERO, 1.5);
            assert!(view.is_finite(), "{name}: no framing camera");
        }
        Err(error) => {
            let message = error.to_string();
            // A fault of the geometry beside a scene description is one of that file.
            let named = message.contains(name) || message.contains("beside.obj");
            assert!(named, "{name}: the message names no file: {message}");
        }
    }
}

#[test]
fn sound_samples_load() {
    let folder = Folder::new();
    folder.write("beside.obj", obj::ROOF);
    for (name, bytes) in samples() {
        let (_, repairs) = read(&folder.write(name, bytes)).expect("a sound file");
        assert!(repairs.is_empty(), "{name}: {repairs}");
    }
}

#[test]
fn every_truncation_ends_in_a_scene_or_an_error() {
    let folder = Folder::new();
    folder.write("beside.obj", obj::ROOF);
    for (name, bytes) in samples() {
        for length in 0..bytes.len() {
            check(&folder, name, &bytes[..length]);
            if name == "a.glb" && length < bytes.len() - 3 {
                assert!(read(&folder.0.join(name)).is_err(), "{length} bytes of a binary file");
            }
        }
    }
}

#[test]
fn paths_without_a_file_are_named() {
    let folder = Folder::new();
    for name in ["none.glb", "none.obj", "none.toml"] {
        let error = read(&folder.0.join(name)).expect_err("there is no file");
        assert!(matches!(error, LoadError::Unreadable { .. }), "unexpected kind: {error}");
        assert!(error.to_string().contains(name), "names the file: {error}");
    }
    for name in ["folder.glb", "folder.obj", "folder.toml"] {
        std::fs::create_dir(folder.0.join(name)).expect("the temporary folder can be written");
        let error = read(&folder.0.join(name)).expect_err("a directory");
        assert!(error.to_string().contains("is a directory"), "says what it is: {error}");
    }
    for name in ["scene.fbx", "scene", ".obj"] {
        let error = read_as(name, "v 0 0 0").expect_err("an unknown ending");
        assert!(matches!(error, LoadError::UnknownFormat { .. }), "unexpected kind: {error}");
    }
    for name in ["empty.glb", "empty.gltf", "empty.obj", "empty.toml"] {
        let error = read_as(name, "").expect_err("an empty file");
        assert!(matches!(error, LoadError::Empty { .. }), "unexpected kind: {error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() })]

    /// Changed, removed and doubled bytes, with numbers that break arithmetic among them.
    #[test]
    fn every_mutation_ends_in_a_scene_or_an_error(
        sample in 0..4_usize,
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0..6_u8), 1..12),
    ) {
        let folder = Folder::new();
        folder.write("beside.obj", obj::ROOF);
        let (name, mut bytes) = samples()[sample].clone();
        for (at, byte, kind) in edits {
            let at = at.index(bytes.len());
            match kind {
                0 | 1 => bytes[at] = byte,
                2 => bytes[at] = b'0' + byte % 10,
                3 => bytes[at] ^= 1 << (byte % 8),
                4 => {
                    bytes.remove(at);
                }
                _ => {
                    let word = ["9", "-", "1e38", "1e300", "nan", "inf", "4294967296", "[", "/"]
                        [usize::from(byte) % 9];
                    bytes.splice(at..at, word.bytes());
                }
            }
            if bytes.is_empty() {
                break;
            }
        }
        check(&folder, name, &bytes);
    }

    /// The binary chunk of a sound file may hold any bit pattern as coordinate or index.
    #[test]
    fn every_binary_chunk_ends_in_a_scene_or_an_error(bin in prop::collection::vec(any::<u8>(), 60)) {
        let mut glb = gltf::square(r#"{"mesh": 0}"#, "");
        let start = glb.len() - bin.len();
        glb[start..].copy_from_slice(&bin);
        check(&Folder::new(), "bin.glb", &glb);
    }
}
