//! Lists the shader modules: every `.wesl` file below this folder, by its path.

use std::path::{Path, PathBuf};
use std::{env, fs, io};

fn main() -> io::Result<()> {
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("set by cargo"));
    let mut files = Vec::new();
    collect(&root, &mut files)?;
    files.sort();
    let mut list = String::from(
        "/// Every module: its path below the package (`common::lookup`) and its source.\n\
         pub const MODULES: &[(&str, &str)] = &[\n",
    );
    for file in &files {
        let path = file.strip_prefix(&root).expect("collected below the root").with_extension("");
        let names: Vec<_> = path.iter().map(|name| name.to_string_lossy()).collect();
        list += &format!("    ({:?}, include_str!({file:?})),\n", names.join("::"));
    }
    list += "];\n";
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("set by cargo"));
    fs::write(out.join("modules.rs"), list)
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    println!("cargo::rerun-if-changed={}", folder.display());
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let is_shader = path.extension().is_some_and(|e| e == "wesl");
        if path.is_dir() && !path.ends_with("src") && !path.ends_with("tests") {
            collect(&path, files)?;
        } else if is_shader {
            files.push(path);
        }
    }
    Ok(())
}
