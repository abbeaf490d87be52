//! OBJ files, and what the library itself writes.

use antumbra_scene::{LoadError, MeshError, Triangles, generate};
use glam::{DVec3, Vec3};

use crate::{Folder, fault_of, read, read_as};

pub(crate) const ROOF: &str = "\
# two polygons over five vertices
mtllib missing.mtl
v 0 0 0
v 1 0 0 0.5 0.5 0.5
v 1 0 1
v 0 0 1 1.0
vn 0 1 0
o level
usemtl stone
f 1//1 2//1 3//1 4//1
v 0.5 1 \\
  0.5
o gable
f -1 1/9/9 -4
";

#[test]
fn polygons_objects_and_relative_indices_are_read() {
    let (scene, repairs) = read_as("roof.obj", ROOF).expect("a sound file");
    assert!(repairs.is_empty(), "nothing to repair: {repairs}");
    let found: Vec<_> = scene.meshes.iter().map(|m| (m.name.as_str(), m.triangles.len())).collect();
    assert_eq!(found, [("level", 2), ("gable", 1)], "a quad and a triangle");
    let gable = [Vec3::new(0.5, 1.0, 0.5), Vec3::ZERO, Vec3::X];
    assert_eq!(scene.meshes[1].positions, gable, "counted back from the last vertex");
}

#[test]
fn faults_are_named_with_their_line() {
    for (text, fault) in [
        ("v 0 0\n", "line 1: the vertex has no z coordinate"),
        ("\nv 0 zero 0\n", "line 2: `zero` is no coordinate"),
        ("v 0 0 0\nf 1 2 x\n", "line 2: `x` is no corner"),
        ("v 0 0 0\nf 0 1 1\n", "line 2: corner `0` of a face refers to no vertex"),
        ("v 0 0 0\nf -2 1 1\n", "line 2: corner `-2` of a face refers to no vertex"),
        ("f 1 2 99999999999\n", "refers to no vertex"),
        ("v 0 0 0\nv 1 0 0\nl 1 2\nf 1 2\n", "2 primitives without triangles"),
        ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "1 degenerate triangles"),
        ("v 0 0 0\nv 1e39 0 0\nv 0 1 0\nf 1 2 3\n", "1 non-finite triangles"),
        ("v 0 0 0\nv 1e30 0 0\nv 0 1 0\nf 1 2 3\n", "too far out"),
        ("# nothing\n", "holds no triangle"),
        ("", "the file is empty"),
    ] {
        let message = fault_of("faulty.obj", text);
        assert!(message.contains(fault), "expected `{fault}`: {message}");
    }
    let error = read_as("range.obj", "v 0 0 0\nf 1 2 3\n").expect_err("vertices are missing");
    let LoadError::Mesh { source: MeshError::IndexOutOfRange { vertices: 1, .. }, .. } = error
    else {
        panic!("unexpected kind of error: {error}");
    };
}

#[test]
fn bytes_that_are_no_text_do_not_matter_in_names() {
    let bytes = [b"o caf\xe9\n".as_slice(), b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"].concat();
    let (scene, _) = read_as("latin.obj", bytes).expect("a sound file");
    assert_eq!(scene.triangle_count(), 1, "one triangle");
}

/// The positions of all triangles in their order; welding may renumber vertices.
fn corners(all: &Triangles) -> Vec<[Vec3; 3]> {
    all.triangles.iter().map(|t| t.map(|i| all.positions[i as usize])).collect()
}

#[test]
fn what_is_written_reads_back_to_the_last_bit() {
    for name in ["rectangle", "sphere", "tree", "convex-cylinder"] {
        let scene = generate::by_name(name).expect("a registered scene");
        let all = scene.triangles(DVec3::ZERO).expect("a valid scene");
        let mut text = Vec::new();
        all.write_obj(&mut text).expect("memory can be written");
        let folder = Folder::new();
        let (back, repairs) = read(&folder.write("back.obj", text)).expect("own files are sound");
        assert!(repairs.is_empty(), "{name}: nothing to repair: {repairs}");
        assert_eq!(back.instances.len(), scene.instances.len(), "{name}: one object an instance");
        let back = back.triangles(DVec3::ZERO).expect("a valid scene");
        assert_eq!(corners(&back), corners(&all), "{name} differs after reading back");
    }
}

#[test]
fn the_origin_is_added_when_writing() {
    let far = DVec3::new(1e6, 0.25, -3.0);
    let scene = generate::by_name("cube").expect("a registered scene").translated(far);
    let all = scene.triangles(far).expect("a valid scene");
    let mut text = Vec::new();
    all.write_obj(&mut text).expect("memory can be written");
    let text = String::from_utf8(text).expect("OBJ is text");
    assert!(text.starts_with("v 999990 0.25 -13\n"), "the floor's first corner: {}", &text[..30]);
    let loose = Triangles {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        triangles: vec![[0, 1, 2]],
        ..Triangles::default()
    };
    let mut text = Vec::new();
    loose.write_obj(&mut text).expect("memory can be written");
    assert!(text.ends_with(b"f 1 2 3\n"), "triangles outside all instances are written too");
}
