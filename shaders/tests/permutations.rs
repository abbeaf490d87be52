//! Every permutation links, and naga accepts the result.

use antumbra_shaders::{
    LinkError, MODULES, link, link_functions, link_source, module, permutations, source,
};

fn validate(wgsl: &str) -> Result<naga::valid::ModuleInfo, String> {
    let parsed = naga::front::wgsl::parse_str(wgsl).map_err(|e| e.emit_to_string(wgsl))?;
    naga::valid::Validator::new(
        naga::valid::ValidationFlags::all(),
        // No capability beyond the WebGPU baseline.
        naga::valid::Capabilities::empty(),
    )
    .validate(&parsed)
    .map_err(|e| e.emit_to_string(wgsl))
}

#[test]
fn every_permutation_links_and_validates() {
    for permutation in permutations() {
        let wgsl = permutation.link().unwrap_or_else(|e| panic!("{}: {e}", permutation.name));
        if let Err(e) = validate(&wgsl) {
            panic!("{}: {e}\n{wgsl}", permutation.name);
        }
    }
}

#[test]
fn names_are_unique() {
    let mut names: Vec<_> = permutations().into_iter().map(|p| p.name).collect();
    let count = names.len();
    names.sort();
    names.dedup();
    assert_eq!(names.len(), count, "two permutations share a name");
}

#[test]
fn every_file_is_embedded() {
    fn visit(dir: &std::path::Path, found: &mut usize) {
        for entry in std::fs::read_dir(dir).expect("the crate's folder is readable") {
            let path = entry.expect("folder entry").path();
            if path.is_dir() {
                visit(&path, found);
            } else if path.extension().is_some_and(|e| e == "wesl") {
                *found += 1;
            }
        }
    }
    let mut found = 0;
    visit(std::path::Path::new(env!("CARGO_MANIFEST_DIR")), &mut found);
    assert_eq!(found, MODULES.len(), "a .wesl file is missing from MODULES");
}

#[test]
fn the_validator_is_awake() {
    assert!(validate("fn f() -> f32 { return 1u; }").is_err(), "a type error must not pass");
}

#[test]
fn an_unbound_slot_is_an_error() {
    let error = link("map::resolve", &[module("layout", "map::layout_single")]);
    assert!(matches!(error, Err(LinkError::Link { .. })), "{error:?}");
}

#[test]
fn an_unknown_module_lists_the_known_ones() {
    let error = link("map::nothing", &[]).expect_err("there is no such module");
    assert!(error.to_string().contains("map::resolve"), "{error}");
}

fn shadow_slots() -> Vec<antumbra_shaders::Slot> {
    vec![
        module("layout", "map::layout_cube"),
        module("store", "common::compare_map"),
        module("estimator", "filter::hardware"),
    ]
}

#[test]
fn functions_for_another_shader_keep_their_names_and_bring_no_bindings_of_their_own() {
    let views = "import package::common::lookup::{ShadowView};
        @group(3) @binding(7) var<storage, read> views: array<ShadowView>;
        fn view_at(i: i32) -> ShadowView { return views[i]; }";
    let mut slots = shadow_slots();
    slots.push(source("map::views", views));
    let keep = ["View", "view_of", "shadow"];
    let wgsl = link_functions("map::shadow", &slots, &keep).expect("links");
    for needed in ["alias View", "fn view_of(", "fn shadow("] {
        assert!(wgsl.contains(needed), "`{needed}` is missing from\n{wgsl}");
    }
    assert_eq!(wgsl.matches("@group").count(), 1, "bindings other than the views in\n{wgsl}");
    assert!(wgsl.contains("@group(3)"), "the caller's views in\n{wgsl}");
    if let Err(e) = validate(&wgsl) {
        panic!("{e}\n{wgsl}");
    }
}

#[test]
fn a_root_given_as_text_may_import_any_module() {
    let text = "import package::map::shadow::{view_of};
        @group(0) @binding(1) var<storage, read_write> out: f32;
        @compute @workgroup_size(1) fn main() { out = view_of(vec3f(1.0)).depth.w; }";
    let wgsl = link_source("mine", text, &shadow_slots()).expect("links");
    if let Err(e) = validate(&wgsl) {
        panic!("{e}\n{wgsl}");
    }
}
