//! A bench under the Khronos validation layer: Vulkan's own opinion of every call that wgpu makes for us.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, bail, ensure};

use crate::provision;

/// Debian's package of the layer.
const PACKAGE: &str = "vulkan-validationlayers";
const MANIFEST: &str = "VkLayer_khronos_validation.json";

/// Runs a small bench under the layer and fails on any message. Where Vulkan has no layer and none may be
/// installed, says so and passes.
pub(crate) fn run() -> anyhow::Result<()> {
    let there = || layer_folders().iter().any(|f| f.join(MANIFEST).is_file());
    let ready = there() || (provision::install_if_allowed(&[PACKAGE])? && there());
    if !ready {
        println!(
            "Not checked: the Khronos validation layer is not installed ({PACKAGE} on Debian)."
        );
        return Ok(());
    }
    let folder = std::env::temp_dir().join(format!("antumbra-validation-{}", std::process::id()));
    std::fs::create_dir_all(&folder)
        .with_context(|| format!("cannot make the directory {}", folder.display()))?;
    let result = check(&folder);
    // What is left behind in a temporary directory does no harm.
    let _ = std::fs::remove_dir_all(&folder);
    result
}

fn check(folder: &Path) -> anyhow::Result<()> {
    // Proof that the layer is awake: its advice on practices always has something to say about wgpu.
    let advice = messages(folder, "error,warn,perf", true)?;
    ensure!(!advice.is_empty(), "the validation layer does not report: its log stayed empty");
    let faults = messages(folder, "error,warn", false)?;
    if !faults.is_empty() {
        bail!("the validation layer complains:\n{faults}");
    }
    println!("No complaint from the validation layer.");
    Ok(())
}

/// What the layer logs over a small bench.
fn messages(folder: &Path, report: &str, best_practices: bool) -> anyhow::Result<String> {
    let log = folder.join("log.txt");
    let mut settings = format!(
        "khronos_validation.debug_action = VK_DBG_LAYER_ACTION_LOG_MSG\n\
         khronos_validation.report_flags = {report}\n\
         khronos_validation.log_filename = {}\n",
        log.display()
    );
    if best_practices {
        settings +=
            "khronos_validation.enables = VK_VALIDATION_FEATURE_ENABLE_BEST_PRACTICES_EXT\n";
    }
    std::fs::write(folder.join("vk_layer_settings.txt"), settings)?;
    std::fs::write(&log, "")?;
    let output = Command::new(std::env::current_exe()?)
        .args(["bench", "--scene", "sphere", "--light", "directional,spot,point"])
        .args(["--size", "64x64", "--map-size", "256", "--repeat", "1", "--out"])
        .arg(folder.join("bench"))
        .env("VK_INSTANCE_LAYERS", "VK_LAYER_KHRONOS_validation")
        .env("VK_LAYER_SETTINGS_PATH", folder)
        .output()
        .context("cannot start the bench")?;
    if !output.status.success() {
        bail!("the bench failed under the layer: {}", String::from_utf8_lossy(&output.stderr));
    }
    std::fs::read_to_string(&log).with_context(|| format!("cannot read {}", log.display()))
}

/// Where Vulkan's loader looks for explicit layers.
fn layer_folders() -> Vec<PathBuf> {
    let from_variable = std::env::var_os("VK_LAYER_PATH");
    let named = from_variable.iter().flat_map(std::env::split_paths);
    let standard = ["/usr/share", "/usr/local/share", "/etc"]
        .map(|root| Path::new(root).join("vulkan").join("explicit_layer.d"));
    named.chain(standard).collect()
}
