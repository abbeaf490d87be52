//! The workspace itself: who may depend on whom, and the stated minimum Rust version.

use std::collections::BTreeSet;
use std::process::Command;

use serde_json::Value;

fn metadata() -> Value {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("cargo prints JSON")
}

/// The crates that each crate of the library may use, not counting tests and benches.
const ALLOWED: &[(&str, &[&str])] = &[
    ("antumbra-scene", &[]),
    ("antumbra-shaders", &[]),
    ("antumbra-reference", &["antumbra-scene"]),
    ("antumbra-gpu", &["antumbra-scene", "antumbra-shaders"]),
    ("antumbra-map", &["antumbra-gpu", "antumbra-scene", "antumbra-shaders"]),
    ("antumbra-filter", &["antumbra-gpu", "antumbra-map", "antumbra-shaders"]),
    ("antumbra-volume", &["antumbra-gpu", "antumbra-shaders"]),
    ("antumbra-sampling", &["antumbra-gpu", "antumbra-map", "antumbra-scene", "antumbra-shaders"]),
    ("antumbra-soft", &["antumbra-gpu", "antumbra-map", "antumbra-scene", "antumbra-shaders"]),
    (
        "antumbra",
        &[
            "antumbra-filter",
            "antumbra-gpu",
            "antumbra-map",
            "antumbra-sampling",
            "antumbra-scene",
            "antumbra-soft",
            "antumbra-volume",
        ],
    ),
    (
        "antumbra-measure",
        &["antumbra", "antumbra-gpu", "antumbra-map", "antumbra-reference", "antumbra-scene"],
    ),
];

fn own_dependencies(package: &Value) -> BTreeSet<&str> {
    let dependencies = package["dependencies"].as_array().into_iter().flatten();
    dependencies
        .filter(|d| d["kind"].is_null())
        .filter_map(|d| d["name"].as_str())
        .filter(|name| name.starts_with("antumbra"))
        .collect()
}

#[test]
fn crates_depend_only_downwards() {
    let metadata = metadata();
    let packages = metadata["packages"].as_array().expect("a list of packages");
    let find = |name: &str| packages.iter().find(|p| p["name"] == name);
    for (name, allowed) in ALLOWED {
        let package = find(name).unwrap_or_else(|| panic!("{name} is not in the workspace"));
        let allowed: BTreeSet<&str> = allowed.iter().copied().collect();
        let used = own_dependencies(package);
        assert!(used.is_subset(&allowed), "{name} uses {used:?}, may use {allowed:?}");
    }
    // A new crate of the library must take its place in the table.
    let members: BTreeSet<&str> = packages
        .iter()
        .filter(|p| p["source"].is_null())
        .filter_map(|p| p["name"].as_str())
        .filter(|n| n.starts_with("antumbra") && *n != "antumbra-tests")
        .collect();
    let listed: BTreeSet<&str> = ALLOWED.iter().map(|(name, _)| *name).collect();
    assert_eq!(members, listed, "crates and the table of this test");
}

#[test]
fn no_dependency_needs_a_newer_rust_than_stated() {
    fn version(text: &str) -> Vec<u32> {
        text.split('.').filter_map(|n| n.parse().ok()).collect()
    }
    let metadata = metadata();
    let packages = metadata["packages"].as_array().expect("a list of packages");
    let stated = packages
        .iter()
        .find(|p| p["name"] == "antumbra")
        .and_then(|p| p["rust_version"].as_str())
        .map(version)
        .expect("a stated version");
    for package in packages {
        if let Some(needs) = package["rust_version"].as_str() {
            assert!(version(needs) <= stated, "{} needs Rust {needs}", package["name"]);
        }
    }
}
