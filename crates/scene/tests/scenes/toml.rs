//! Scene descriptions.

use antumbra_scene::{Light, LightKind};
use glam::DVec3;

use crate::{Folder, fault_of, gltf, obj, read};

#[test]
fn the_documented_example_loads_as_described() {
    let page = include_str!("../../../../docs/scene-files.md");
    let example = page.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next());
    let example = example.expect("the page begins with a complete example");
    let folder = Folder::new();
    std::fs::create_dir(folder.0.join("models")).expect("the temporary folder can be written");
    folder.write("models/house.glb", gltf::square(r#"{"mesh": 0}"#, ""));
    folder.write("models/roof.obj", obj::ROOF);
    let (scene, repairs) = read(&folder.write("yard.toml", example)).expect("the example is sound");
    assert!(repairs.is_empty(), "nothing to repair: {repairs}");
    assert_eq!(scene.name, "yard", "the name it gives itself");
    assert_eq!(scene.meshes.len(), 4, "a square, two parts of the roof, the ground");
    assert_eq!(scene.instances.len(), 6, "one house, two roofs of two parts, the ground");
    assert_eq!(scene.ground, Some(5), "the ground is marked");
    let kinds: Vec<LightKind> = scene.lights.iter().map(Light::kind).collect();
    for kind in LightKind::ALL {
        assert!(kinds.contains(&kind), "the example shows a {} light", kind.name());
    }
    let camera = scene.camera.expect("the example has a camera");
    assert!((camera.fov_y - 40_f64.to_radians()).abs() < 1e-12, "degrees in the file");
    let ground = scene.instance_bounds(&scene.instances[5]);
    assert_eq!((ground.min.y, ground.max.x - ground.min.x), (-0.01, 60.0), "as given");
}

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\n";

#[test]
fn transforms_scale_then_turn_then_move() {
    let folder = Folder::new();
    folder.write("t.obj", TRIANGLE);
    // x (1, 0, 0) is doubled, stays under the turn around x, goes to -z around y, stays around z's
    // turn of zero, and moves. z goes to -y around x, and there it stays around y.
    let text = "[[mesh]]\nfile = \"t.obj\"\nname = \"one\"\nscale = [2, 1, 1]\n\
                rotate = [90, 90, 0]\ntranslate = [0, 5, 0.0]\n";
    let (scene, _) = read(&folder.write("s.toml", text)).expect("a sound file");
    assert_eq!(scene.instances[0].name, "one", "named by the table");
    let at = |p| scene.instances[0].transform.transform_point3(p);
    assert!(at(DVec3::X).distance(DVec3::new(0.0, 5.0, -2.0)) < 1e-12, "{}", at(DVec3::X));
    assert!(at(DVec3::Z).distance(DVec3::new(0.0, 4.0, 0.0)) < 1e-12, "{}", at(DVec3::Z));
}

#[test]
fn faults_are_named_with_what_would_be_right() {
    let folder = Folder::new();
    folder.write("t.obj", TRIANGLE);
    folder.write("nested.toml", "[[mesh]]\nfile = \"nested.toml\"\n");
    let sun = "[[light]]\nkind = \"directional\"\n";
    for (text, faults) in [
        ("colour = 1".to_owned(), &["unknown field `colour`", "mesh", "camera", "light"][..]),
        ("[[mesh]]\nfile = \"t.obj\"\ntranslation = [0, 0, 0]".to_owned(), &["`translation`", "`translate`"]),
        (format!("{sun}direction = [0, -1, 0]\nsize = 2"), &["`size`", "angular_diameter"]),
        ("[[light]]\nkind = \"laser\"".to_owned(), &["`laser`", "`directional`", "`disc`"]),
        (format!("{sun}direction = [0, 0, 0]"), &["light 1: `direction` must not be zero"]),
        (format!("{sun}direction = [0, nan, 0]"), &["light 1: `direction` must be three finite"]),
        (format!("{sun}direction = [0, 1]"), &["3"]),
        (format!("{sun}direction = [0, -1, 0]\nangular_diameter = 180"), &["below 180 degrees"]),
        ("[[light]]\nkind = \"sphere\"\ncenter = [0, 1, 0]\nradius = -1".to_owned(), &["`radius` is -1"]),
        (
            "[[light]]\nkind = \"rect\"\ncenter = [0, 1, 0]\nhalf_u = [1, 0, 0]\nhalf_v = [1, 1, 0]"
                .to_owned(),
            &["right angles"],
        ),
        (
            "[[light]]\nkind = \"spot\"\nposition = [0, 1, 0]\ndirection = [0, -1, 0]\nouter_angle = 90"
                .to_owned(),
            &["between 0 and 90 degrees"],
        ),
        ("[camera]\neye = [1, 1, 1]\ntarget = [1, 1, 1]".to_owned(), &["`target` must differ"]),
        ("[camera]\neye = [1, 1, 1]\ntarget = [0, 1, 1]\nnear = 0".to_owned(), &["`near` is 0"]),
        ("[[mesh]]\nfile = \"nested.toml\"".to_owned(), &["mesh 1: `file` must name"]),
        ("[[mesh]]\nfile = \"missing.obj\"".to_owned(), &["missing.obj"]),
        ("[[mesh]]\nfile = \"t.obj\"\nscale = \"big\"".to_owned(), &["one number or three"]),
        ("[[mesh]]\nfile = \"t.obj\"\nscale = 0".to_owned(), &["1 degenerate triangles dropped"]),
        ("[[mesh]]\nfile = \"t.obj\"\ntranslate = [1e13, 0, 0]".to_owned(), &["too far out"]),
        ("[[mesh]]\nfile = \"t.obj\"\n[ground]\nhalf_size = 0".to_owned(), &["`half_size` is 0"]),
        ("[ground]".to_owned(), &["holds no triangle"]),
        ("name = ".to_owned(), &["line 1"]),
    ] {
        let path = folder.write("faulty.toml", &text);
        let message = read(&path).expect_err("a faulty file").to_string();
        for fault in faults {
            assert!(message.contains(fault), "{text}\nexpected `{fault}`: {message}");
        }
    }
    let message = fault_of("bytes.toml", [b'a', 0xff]);
    assert!(message.contains("no UTF-8 text after byte 1"), "{message}");
}
