//! glTF files, built byte by byte.

use antumbra_scene::{Light, LightKind, LoadError, LoadOptions, MeshError, load};
use glam::{DVec3, Vec3};

use crate::{Folder, fault_of, read, read_as};

/// A binary glTF file of a JSON text and a binary chunk.
pub(crate) fn glb(json: &str, bin: &[u8]) -> Vec<u8> {
    let chunk = |kind: &[u8; 4], bytes: &[u8], pad: u8| {
        let mut bytes = bytes.to_vec();
        bytes.resize(bytes.len().next_multiple_of(4), pad);
        [&(bytes.len() as u32).to_le_bytes()[..], kind, &bytes].concat()
    };
    let chunks = [chunk(b"JSON", json.as_bytes(), b' '), chunk(b"BIN\0", bin, 0)].concat();
    let length = 12 + chunks.len() as u32;
    [b"glTF".as_slice(), &2_u32.to_le_bytes(), &length.to_le_bytes(), &chunks].concat()
}

fn floats(points: &[[f32; 3]]) -> Vec<u8> {
    points.iter().flatten().flat_map(|x| x.to_le_bytes()).collect()
}

const SQUARE: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0]];

/// The bytes of a square: four positions, then six 16-bit indices.
fn square_bytes() -> Vec<u8> {
    let indices: Vec<u8> = [0_u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()).collect();
    [floats(&SQUARE), indices].concat()
}

/// The parts of a JSON text that describe those bytes as accessors 0 (positions) and 1 (indices).
fn square_json(buffer: &str, nodes: &str, more: &str) -> String {
    format!(
        r#"{{"asset": {{"version": "2.0"}}, "buffers": [{buffer}],
        "bufferViews": [{{"buffer": 0, "byteLength": 48}},
                        {{"buffer": 0, "byteOffset": 48, "byteLength": 12}}],
        "accessors": [
            {{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}},
            {{"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}}],
        "meshes": [{{"name": "square", "primitives": [
            {{"attributes": {{"POSITION": 0}}, "indices": 1}}]}}],
        "nodes": [{nodes}] {more}}}"#
    )
}

pub(crate) fn square(nodes: &str, more: &str) -> Vec<u8> {
    glb(&square_json(r#"{"byteLength": 60}"#, nodes, more), &square_bytes())
}

/// One mesh of one primitive over the given positions, without indices.
fn unindexed(points: &[[f32; 3]], mode: u32) -> Vec<u8> {
    let (count, bytes) = (points.len(), 12 * points.len());
    glb(
        &format!(
            r#"{{"asset": {{"version": "2.0"}}, "buffers": [{{"byteLength": {bytes}}}],
            "bufferViews": [{{"buffer": 0, "byteLength": {bytes}}}],
            "accessors": [{{"bufferView": 0, "componentType": 5126, "count": {count}, "type": "VEC3"}}],
            "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "mode": {mode}}}]}}],
            "nodes": [{{"mesh": 0}}]}}"#
        ),
        &floats(points),
    )
}

#[test]
fn a_mesh_of_several_nodes_is_shared_by_several_instances() {
    let nodes = r#"{"name": "parent", "mesh": 0, "scale": [2, 2, 2], "children": [1, 2]},
        {"name": "moved", "mesh": 0, "translation": [10, 0, 0]},
        {"name": "turned", "mesh": 0, "matrix": [0,0,-1,0, 0,1,0,0, 1,0,0,0, 0,5,0,1]}"#;
    let (scene, repairs) = read_as("instances.glb", square(nodes, "")).expect("a sound file");
    assert!(repairs.is_empty(), "nothing to repair: {repairs}");
    assert_eq!(scene.meshes.len(), 1, "the mesh is stored once");
    assert_eq!(scene.name, "instances", "named after the file");
    let names: Vec<&str> = scene.instances.iter().map(|i| i.name.as_str()).collect();
    assert_eq!(names, ["parent", "moved", "turned"], "in the order of the file");
    let bounds = |i: usize| scene.instance_bounds(&scene.instances[i]);
    assert_eq!(bounds(0).max, DVec3::new(2.0, 0.0, 2.0), "scaled");
    assert_eq!(bounds(1).min, DVec3::new(20.0, 0.0, 0.0), "moved, then scaled by the parent");
    // The matrix takes x to -z and z to x, and lifts by 5, doubled by the parent.
    assert_eq!(bounds(2).min, DVec3::new(0.0, 10.0, -2.0), "turned about y");
    assert_eq!(bounds(2).max, DVec3::new(2.0, 10.0, 0.0), "turned about y");
    assert_eq!(scene.triangle_count(), 6, "three times two triangles");
}

#[test]
fn triangles_strips_and_fans_without_indices_are_read() {
    let strip = [SQUARE[0], SQUARE[1], SQUARE[3], SQUARE[2]];
    for (mode, points, what) in [(5, &strip, "strip"), (6, &SQUARE, "fan")] {
        let (scene, repairs) = read_as("mode.glb", unindexed(points, mode)).expect("a sound file");
        assert!(repairs.is_empty(), "{what}: nothing to repair: {repairs}");
        let mesh = &scene.meshes[0];
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (4, 2), "{what}: a square");
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            assert_eq!((b - a).cross(c - a), Vec3::NEG_Y, "{what}: both turn the same way");
        }
    }
    let two = [SQUARE[0], SQUARE[1], SQUARE[2], SQUARE[0], SQUARE[2], SQUARE[3], SQUARE[1]];
    let (scene, repairs) = read_as("list.glb", unindexed(&two, 4)).expect("a sound file");
    assert_eq!(scene.meshes[0].positions.len(), 4, "welded");
    assert_eq!(repairs.degenerate_triangles, 1, "the list ends within a triangle");
}

#[test]
fn without_welding_vertices_stay_apart() {
    let folder = Folder::new();
    let two = [SQUARE[0], SQUARE[1], SQUARE[2], SQUARE[0], SQUARE[2], SQUARE[3]];
    let path = folder.write("apart.glb", unindexed(&two, 4));
    let options = LoadOptions { weld: false, ..LoadOptions::default() };
    let (scene, _) = load(&path, &options).expect("a sound file");
    assert_eq!(scene.meshes[0].positions.len(), 6, "as in the file");
}

#[test]
fn faulty_triangles_are_dropped_and_counted() {
    let nan = [f32::NAN, 0.0, 0.0];
    let infinite = [0.0, f32::INFINITY, 0.0];
    let [a, b, c, d] = SQUARE;
    let points = [a, b, c, a, b, nan, a, infinite, c, a, a, c, a, [0.5, 0.0, 0.0], b, a, c, d];
    let (scene, repairs) = read_as("faulty.glb", unindexed(&points, 4)).expect("repairable");
    assert_eq!((repairs.non_finite_triangles, repairs.degenerate_triangles), (2, 2), "{repairs}");
    assert_eq!(scene.meshes[0].triangles.len(), 2, "the sound ones remain");
    assert_eq!(scene.meshes[0].validate(), Ok(()), "no faulty vertex remains");
    let message = fault_of("all-nan.glb", unindexed(&[nan, nan, nan], 4));
    assert!(message.contains("1 non-finite triangles dropped"), "says why: {message}");
}

#[test]
fn a_transform_that_flattens_leaves_no_degenerate_triangle() {
    let points = [SQUARE[0], SQUARE[1], SQUARE[2], [0.0; 3], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut bytes = unindexed(&points, 4);
    let (from, to) = (br#"[{"mesh": 0}]"#, br#"[{"mesh": 0, "scale": [1, 0, 1]}]"#);
    let json_length = u32::from_le_bytes(bytes[12..16].try_into().expect("four bytes"));
    let text = String::from_utf8_lossy(&bytes[20..20 + json_length as usize]).into_owned();
    let text = text.replace(&*String::from_utf8_lossy(from), &String::from_utf8_lossy(to));
    bytes = glb(&text, &floats(&points));
    let (scene, repairs) = read_as("flat.glb", bytes).expect("one triangle remains");
    assert_eq!(repairs.degenerate_triangles, 1, "the upright triangle has no area left");
    assert_eq!(scene.triangle_count(), 1, "the level one stays");
}

#[test]
fn an_index_beyond_the_vertices_is_an_error() {
    let mut bytes = square_bytes();
    bytes[48..50].copy_from_slice(&4_u16.to_le_bytes());
    let file = glb(&square_json(r#"{"byteLength": 60}"#, r#"{"mesh": 0}"#, ""), &bytes);
    let error = read_as("range.glb", file).expect_err("index 4 of 4 vertices");
    let LoadError::Mesh { source: MeshError::IndexOutOfRange { triangle, vertices, .. }, .. } =
        error
    else {
        panic!("unexpected kind of error: {error}");
    };
    assert_eq!((triangle, vertices), (0, 4), "names the first triangle");
}

#[test]
fn cameras_and_lights_are_placed_by_their_nodes() {
    // Half a turn around y takes -z to +z.
    let nodes = r#"{"mesh": 0}, {"camera": 0, "translation": [0, 2, -5], "rotation": [0, 1, 0, 0]},
        {"translation": [0, 9, 0], "rotation": [-0.70710678, 0, 0, 0.70710678],
         "extensions": {"KHR_lights_punctual": {"light": 0}}},
        {"translation": [0, 9, 0], "extensions": {"KHR_lights_punctual": {"light": 1}}},
        {"rotation": [-0.70710678, 0, 0, 0.70710678],
         "extensions": {"KHR_lights_punctual": {"light": 2}}},
        {"camera": 1}, {"extensions": {"KHR_lights_punctual": {"light": 3}}}"#;
    let more = r#", "cameras": [
        {"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.2}},
        {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "zfar": 9, "znear": 0}}],
        "extensionsUsed": ["KHR_lights_punctual"], "extensionsRequired": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": [
            {"type": "spot", "spot": {"outerConeAngle": 0.5}}, {"type": "point"},
            {"type": "directional"}, {"type": "spot", "spot": {"outerConeAngle": 3.0}}]}}"#;
    let (scene, repairs) = read_as("lights.glb", square(nodes, more)).expect("a sound file");
    let camera = scene.camera.expect("a perspective camera");
    assert_eq!(camera.eye, DVec3::new(0.0, 2.0, -5.0), "where its node is");
    assert!(camera.forward().distance(DVec3::Z) < 1e-7, "looks along -z of its node");
    assert!((camera.fov_y - 0.7).abs() < 1e-7 && (camera.near - 0.2).abs() < 1e-7, "{camera:?}");
    let kinds: Vec<LightKind> = scene.lights.iter().map(Light::kind).collect();
    assert_eq!(kinds, [LightKind::Spot, LightKind::Point, LightKind::Directional], "in order");
    let Light::Spot { position, direction, outer_angle } = scene.lights[0] else {
        panic!("the first light is a spot");
    };
    assert_eq!(position, DVec3::new(0.0, 9.0, 0.0), "where its node is");
    assert!(direction.distance(DVec3::NEG_Y) < 1e-7, "shines along -z of its node: {direction}");
    assert!((outer_angle - 0.5).abs() < 1e-7, "half angle {outer_angle}");
    assert_eq!((repairs.ignored_cameras, repairs.ignored_lights), (1, 1), "{repairs}");
}

#[test]
fn node_hierarchies_that_are_no_trees_are_refused_and_deep_ones_read() {
    let cycle = r#"{"children": [1]}, {"mesh": 0, "children": [0]}"#;
    let scene = r#", "scene": 0, "scenes": [{"nodes": [0]}]"#;
    let message = fault_of("cycle.glb", square(cycle, scene));
    assert!(message.contains("its own ancestor"), "names the fault: {message}");
    // Without scenes no node of the cycle is a root.
    assert!(
        matches!(read_as("cycle.glb", square(cycle, "")), Err(LoadError::Empty { .. })),
        "empty"
    );
    // A ladder in which every node has the next one twice as child would have 2^n leaves.
    let ladder: Vec<String> = (1..60).map(|n| format!(r#"{{"children": [{n}, {n}]}}"#)).collect();
    let message =
        fault_of("ladder.glb", square(&format!(r#"{},{{"mesh": 0}}"#, ladder.join(",")), ""));
    assert!(message.contains("two parents"), "names the fault: {message}");
    let chain: Vec<String> = (1..20_000)
        .map(|n| format!(r#"{{"children": [{n}], "translation": [0.5, 0, 0]}}"#))
        .collect();
    let nodes = format!(r#"{},{{"mesh": 0}}"#, chain.join(","));
    let (scene, _) = read_as("chain.glb", square(&nodes, "")).expect("deep, but a tree");
    assert_eq!(scene.bounds().min.x, 9999.5, "19,999 steps of half a metre");
    let growing: Vec<String> = (1..200)
        .map(|n| format!(r#"{{"children": [{n}], "scale": [1e30, 1e30, 1e30]}}"#))
        .collect();
    let nodes = format!(r#"{},{{"mesh": 0}}"#, growing.join(","));
    assert!(fault_of("growing.glb", square(&nodes, "")).contains("too far out"), "overflow");
    assert!(
        fault_of("far.glb", square(r#"{"mesh": 0, "translation": [1e13, 0, 0]}"#, ""))
            .contains("too far out"),
        "a translation beyond the reach"
    );
}

#[test]
fn more_instances_than_allowed_are_refused() {
    let folder = Folder::new();
    let nodes = vec![r#"{"mesh": 0}"#; 100].join(",");
    let path = folder.write("many.glb", square(&nodes, ""));
    let limit = |max_triangles| LoadOptions { max_triangles, ..LoadOptions::default() };
    assert!(load(&path, &limit(200)).is_ok(), "100 times two triangles");
    let refused = load(&path, &limit(199));
    assert!(matches!(refused, Err(LoadError::TooLarge { limit: 199, .. })), "{refused:?}");
}

#[test]
fn buffers_come_from_files_and_data_uris_and_images_are_left_alone() {
    let folder = Folder::new();
    folder.write("my square.bin", square_bytes());
    let images = r#", "images": [{"uri": "missing.png"}], "textures": [{}, {"source": 0}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}}],
        "extensionsRequired": ["KHR_texture_basisu"], "extensionsUsed": ["KHR_texture_basisu"]"#;
    let node = r#"{"mesh": 0}"#;
    let external = square_json(r#"{"byteLength": 60, "uri": "my%20square.bin"}"#, node, images);
    let (scene, _) = read(&folder.write("external.gltf", &external)).expect("a file beside it");
    assert_eq!(scene.triangle_count(), 2, "the square");

    let data = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAACAPwAAAAAAAIA/AAAAAAAAAAAAAIA/AAABAAIAAAACAAMA";
    let uri =
        format!(r#"{{"byteLength": 60, "uri": "data:application/octet-stream;base64,{data}"}}"#);
    let (inline, _) =
        read(&folder.write("data.gltf", square_json(&uri, node, ""))).expect("inline");
    assert_eq!(inline.meshes, scene.meshes, "the same square");

    let refuse = |uri: &str, fault: &str| {
        let buffer = format!(r#"{{"byteLength": 60, "uri": "{uri}"}}"#);
        let path = folder.write("refused.gltf", square_json(&buffer, node, ""));
        let message = read(&path).expect_err("a faulty buffer").to_string();
        assert!(message.contains("refused.gltf"), "names the file: {message}");
        assert!(message.contains(fault), "{uri}: {message}");
    };
    refuse("missing.bin", "missing.bin");
    refuse(".", "is a directory");
    refuse("%ff.bin", "no valid path");
    refuse("https://example.invalid/a.bin", "not a relative path");
    refuse("data:;base64,AAAA", "cut off");
    refuse("data:;base64,A A", "not valid base 64");
    refuse("data:,AAAA", "not base 64");
    #[cfg(unix)]
    refuse("/dev/zero", "no regular file");
}

#[test]
fn sparse_and_quantised_positions_are_read() {
    // Accessor 0: zeros, of which three are replaced; accessor 1: normalised bytes.
    let bin = [&[1, 2, 3, 0][..], &floats(&[SQUARE[1], SQUARE[2], SQUARE[3]])].concat();
    let bin = [&bin[..], &[0, 0, 0, 0, 127, 0, 0, 0, 127, 0, 127, 0]].concat();
    let json = r#"{"asset": {"version": "2.0"}, "buffers": [{"byteLength": 52}],
        "extensionsRequired": ["KHR_mesh_quantization"],
        "bufferViews": [{"buffer": 0, "byteLength": 3}, {"buffer": 0, "byteOffset": 4, "byteLength": 36},
            {"buffer": 0, "byteOffset": 40, "byteLength": 12, "byteStride": 4}],
        "accessors": [{"componentType": 5126, "count": 4, "type": "VEC3", "sparse": {"count": 3,
            "indices": {"bufferView": 0, "componentType": 5121}, "values": {"bufferView": 1}}},
            {"bufferView": 2, "componentType": 5120, "count": 3, "type": "VEC3", "normalized": true}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 6},
            {"attributes": {"POSITION": 1}}, {"attributes": {"POSITION": 1}, "mode": 1}]}],
        "nodes": [{"mesh": 0}]}"#;
    let (scene, repairs) = read_as("sparse.glb", glb(json, &bin)).expect("a sound file");
    assert_eq!(scene.meshes[0].positions, SQUARE.map(Vec3::from_array), "the square");
    let small = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 0.0, 1.0)];
    assert_eq!(scene.meshes[1].positions, small, "127 of 127 is 1");
    assert_eq!(repairs.skipped_primitives, 1, "lines cast no shadow here");
    let beyond = json.replace(r#""count": 4,"#, r#""count": 3,"#);
    assert!(fault_of("sparse.glb", glb(&beyond, &bin)).contains("sparse index 3"), "out of range");
    let bomb = json.replace(r#""count": 4,"#, r#""count": 4000000000,"#);
    assert!(fault_of("bomb.glb", glb(&bomb, &bin)).contains("without a buffer view"), "refused");
}

#[test]
fn damaged_structure_is_named() {
    let whole = square_json(r#"{"byteLength": 60}"#, r#"{"mesh": 0}"#, "");
    for (from, to, fault) in [
        (r#""version": "2.0""#, r#""version": "1.0""#, "glTF version `1.0`"),
        (r#""mesh": 0}"#, r#""mesh": 7}"#, "mesh 7 of 1"),
        (r#""POSITION": 0"#, r#""POSITION": 9"#, "accessor 9 of 2"),
        (r#""indices": 1"#, r#""indices": 0"#, "must hold elements of type Scalar"),
        (
            r#"{"buffer": 0, "byteLength": 48}"#,
            r#"{"buffer": 3, "byteLength": 48}"#,
            "buffer 3 of 1",
        ),
        (r#""byteLength": 48}"#, r#""byteLength": 40}"#, "reach beyond buffer view 0"),
        (r#""byteOffset": 48,"#, r#""byteOffset": 49,"#, "reaches beyond its buffer"),
        (r#""count": 6"#, r#""count": 18446744073709551615"#, "reach beyond buffer view 1"),
        (r#"{"byteLength": 60}"#, r#"{"byteLength": 600}"#, "cut off: 60 of 600"),
        (r#""indices": 1}"#, r#""indices": 1, "mode": 9}"#, "unknown mode"),
        (r#""nodes":"#, r#""scene": 3, "nodes":"#, "scene 3 of 0"),
        (
            r#""nodes":"#,
            r#""extensionsRequired": ["KHR_draco_mesh_compression"], "nodes":"#,
            "draco",
        ),
    ] {
        let json = whole.replacen(from, to, 1);
        assert_ne!(json, whole, "the replacement of {from} must take place");
        let message = fault_of("damaged.glb", glb(&json, &square_bytes()));
        assert!(message.contains(fault), "expected `{fault}`: {message}");
    }
    let lines = whole.replace(r#""indices": 1}"#, r#""indices": 1, "mode": 1}"#);
    let message = fault_of("lines.glb", glb(&lines, &square_bytes()));
    assert!(message.contains("1 primitives without triangles"), "says what it holds: {message}");
    let mut short = square(r#"{"mesh": 0}"#, "");
    short[8..12].copy_from_slice(&5_u32.to_le_bytes());
    assert!(fault_of("short.glb", short).contains("header"), "a length below the header's own");
}
