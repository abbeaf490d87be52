//! `cargo xtask shaders`: export to other shading languages, and validation of every permutation.

use std::path::Path;

use antumbra_shaders::{Permutation, permutations};
use anyhow::{Context as _, anyhow};
use naga::back;
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};

use crate::args::ShaderLanguage;

/// Writes every shader permutation in language `to` into `dir`.
pub(crate) fn export(to: ShaderLanguage, dir: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(dir)
        .with_context(|| format!("cannot make the directory {}", dir.display()))?;
    let mut files = 0;
    for permutation in permutations() {
        let (wgsl, module, info) = validated(&permutation)?;
        let written = match to {
            ShaderLanguage::Wgsl => vec![(format!("{}.wgsl", permutation.name), wgsl.into_bytes())],
            ShaderLanguage::Spirv => {
                vec![(format!("{}.spv", permutation.name), spirv(&module, &info)?)]
            }
            ShaderLanguage::Msl => {
                vec![(format!("{}.metal", permutation.name), msl(&module, &info)?)]
            }
            ShaderLanguage::Hlsl => {
                vec![(format!("{}.hlsl", permutation.name), hlsl(&module, &info)?)]
            }
            ShaderLanguage::Glsl => glsl(&permutation.name, &module, &info)?,
        };
        for (name, bytes) in written {
            let path = dir.join(name);
            std::fs::write(&path, bytes)
                .with_context(|| format!("cannot write {}", path.display()))?;
            files += 1;
        }
    }
    println!("Wrote {files} files into {}", dir.display());
    Ok(())
}

/// Links and validates every shader permutation.
pub(crate) fn check() -> anyhow::Result<()> {
    let all = permutations();
    for permutation in &all {
        let (_, module, info) = validated(permutation)?;
        // Every back end must take what is exported.
        spirv(&module, &info).with_context(|| permutation.name.clone())?;
        msl(&module, &info).with_context(|| permutation.name.clone())?;
        hlsl(&module, &info).with_context(|| permutation.name.clone())?;
        glsl(&permutation.name, &module, &info)?;
    }
    println!("{} shader permutations link and validate", all.len());
    Ok(())
}

/// The permutation as WGSL and as a valid naga module, without any capability beyond WebGPU's baseline.
fn validated(permutation: &Permutation) -> anyhow::Result<(String, naga::Module, ModuleInfo)> {
    let name = &permutation.name;
    let wgsl = permutation.link()?;
    let module = naga::front::wgsl::parse_str(&wgsl)
        .map_err(|e| anyhow!("{name}: {}", e.emit_to_string(&wgsl)))?;
    let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(&module)
        .map_err(|e| anyhow!("{name}: {}", e.emit_to_string(&wgsl)))?;
    Ok((wgsl, module, info))
}

fn spirv(module: &naga::Module, info: &ModuleInfo) -> anyhow::Result<Vec<u8>> {
    let words = back::spv::write_vec(module, info, &back::spv::Options::default(), None)?;
    Ok(words.into_iter().flat_map(u32::to_le_bytes).collect())
}

fn msl(module: &naga::Module, info: &ModuleInfo) -> anyhow::Result<Vec<u8>> {
    // Bindings are given fake slots: the engine that uses the export maps its own.
    // Invariant positions need 2.1 (macOS 10.14).
    let options = back::msl::Options {
        fake_missing_bindings: true,
        lang_version: (2, 1),
        ..Default::default()
    };
    let (text, _) = back::msl::write_string(module, info, &options, &Default::default())?;
    Ok(text.into_bytes())
}

fn hlsl(module: &naga::Module, info: &ModuleInfo) -> anyhow::Result<Vec<u8>> {
    let mut text = String::new();
    let options = back::hlsl::Options { fake_missing_bindings: true, ..Default::default() };
    let pipeline = back::hlsl::PipelineOptions::default();
    back::hlsl::Writer::new(&mut text, &options, &pipeline).write(module, info, None)?;
    Ok(text.into_bytes())
}

/// GLSL has one entry point a file.
fn glsl(
    name: &str,
    module: &naga::Module,
    info: &ModuleInfo,
) -> anyhow::Result<Vec<(String, Vec<u8>)>> {
    // 4.50 has everything that the shaders use: storage buffers, storage images, depth arrays.
    let options =
        back::glsl::Options { version: back::glsl::Version::Desktop(450), ..Default::default() };
    let mut files = Vec::new();
    for entry in &module.entry_points {
        let pipeline = back::glsl::PipelineOptions {
            shader_stage: entry.stage,
            entry_point: entry.name.clone(),
            multiview: None,
        };
        let ending = match entry.stage {
            naga::ShaderStage::Vertex => "vert",
            naga::ShaderStage::Fragment => "frag",
            _ => "comp",
        };
        let mut text = String::new();
        let policies = naga::proc::BoundsCheckPolicies::default();
        back::glsl::Writer::new(&mut text, module, info, &options, &pipeline, policies)
            .and_then(|mut writer| writer.write())
            .with_context(|| format!("{name}, {}", entry.name))?;
        files.push((format!("{name}.{ending}"), text.into_bytes()));
    }
    Ok(files)
}
