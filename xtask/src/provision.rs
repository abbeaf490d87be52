//! Makes sure that a GPU adapter exists before anything needs one.
//!
//! On Debian and Ubuntu the distribution's software Vulkan driver is installed where there is no
//! other adapter and the user may; anywhere else the one command to run is printed.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use anyhow::{Context as _, bail};

/// Debian's names of the Vulkan loader and of Mesa's drivers, the software one among them.
const PACKAGES: [&str; 2] = ["libvulkan1", "mesa-vulkan-drivers"];

/// Set for the process that starts over after an install, so that it does not install again.
const STARTED_OVER: &str = "ANTUMBRA_DRIVER_INSTALLED";

/// What decides how a missing adapter is dealt with.
#[derive(Clone, Debug, Default)]
struct Facts {
    /// `std::env::consts::OS`.
    os: String,
    /// The text of `/etc/os-release`, empty if there is none.
    os_release: String,
    /// Whether the user is root.
    root: bool,
    /// Whether `sudo` works without a password.
    sudo: bool,
    /// Whether this process was started by one that has just installed the driver.
    installed: bool,
}

/// How a missing adapter is dealt with.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Plan {
    /// Install the packages, through `sudo` or not.
    Install { sudo: bool },
    /// Stop, and tell what to do.
    Stop(String),
}

/// Returns once an adapter exists, after installing a software driver if need be. Starts the
/// process over after an install, since a Vulkan loader that was missing at first is not looked for
/// again by all parts of a process.
///
/// Call it before the process has threads: it may set `XDG_RUNTIME_DIR`.
pub(crate) fn ensure_adapter() -> anyhow::Result<RuntimeDir> {
    let runtime_dir = RuntimeDir::ensure();
    if adapter_exists() {
        return Ok(runtime_dir);
    }
    match plan(&gather()) {
        Plan::Stop(message) => bail!(message),
        Plan::Install { sudo } => {
            println!(
                "No GPU adapter found: installing the software Vulkan driver of this distribution ({}).",
                PACKAGES.join(", ")
            );
            install(sudo, &PACKAGES)?;
            start_over(runtime_dir)
        }
    }
}

/// Whether wgpu finds any adapter of an API that it fully supports, or of those that the
/// environment variable `WGPU_BACKEND` asks for.
fn adapter_exists() -> bool {
    let backends = wgpu::Backends::from_env().unwrap_or(wgpu::Backends::PRIMARY);
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends,
        flags: wgpu::InstanceFlags::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    !pollster::block_on(instance.enumerate_adapters(backends)).is_empty()
}

fn gather() -> Facts {
    let succeeds = |program: &str, args: &[&str]| {
        Command::new(program)
            .args(args)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .is_ok_and(|s| s.success())
    };
    let uid = Command::new("id").arg("-u").output().map(|o| o.stdout).unwrap_or_default();
    Facts {
        os: std::env::consts::OS.to_owned(),
        os_release: std::fs::read_to_string("/etc/os-release").unwrap_or_default(),
        root: uid.trim_ascii() == b"0",
        sudo: succeeds("sudo", &["-n", "true"]),
        installed: std::env::var_os(STARTED_OVER).is_some(),
    }
}

fn plan(facts: &Facts) -> Plan {
    let families = families(&facts.os_release);
    let is = |family: &str| families.iter().any(|f| f == family);
    if facts.installed {
        return Plan::Stop(
            "still no GPU adapter after installing the software Vulkan driver; unset VK_DRIVER_FILES, \
             VK_ICD_FILENAMES and WGPU_BACKEND if they are set, and look at the output of `vulkaninfo` \
             (package vulkan-tools)"
                .to_owned(),
        );
    }
    let debian = is("debian") || is("ubuntu");
    if debian && (facts.root || facts.sudo) {
        return Plan::Install { sudo: !facts.root };
    }
    let command = if facts.os != "linux" {
        return Plan::Stop(format!(
            "no GPU adapter: update the graphics driver of this {} system and try again",
            facts.os
        ));
    } else if debian {
        "sudo apt-get install -y --no-install-recommends libvulkan1 mesa-vulkan-drivers"
    } else if is("fedora") || is("rhel") {
        "sudo dnf install -y vulkan-loader mesa-vulkan-drivers"
    } else if is("arch") {
        "sudo pacman -S --needed vulkan-icd-loader vulkan-swrast"
    } else if is("suse") || is("opensuse") {
        "sudo zypper install libvulkan1 libvulkan_lvp"
    } else if is("alpine") {
        "doas apk add vulkan-loader mesa-vulkan-swrast"
    } else {
        return Plan::Stop(
            "no GPU adapter: install the Vulkan loader and Mesa's software Vulkan driver (lavapipe) \
             with the package manager of this system, then try again"
                .to_owned(),
        );
    };
    Plan::Stop(format!(
        "no GPU adapter. Install a software Vulkan driver, then try again:\n\n    {command}\n"
    ))
}

/// The values of `ID` and `ID_LIKE` in the text of `/etc/os-release`.
fn families(os_release: &str) -> Vec<String> {
    os_release
        .lines()
        .filter_map(|line| line.trim().split_once('='))
        .filter(|(key, _)| matches!(*key, "ID" | "ID_LIKE"))
        .flat_map(|(_, value)| value.trim_matches(['"', '\'']).split_whitespace())
        .map(str::to_owned)
        .collect()
}

/// Installs the distribution's `packages` where that is Debian or Ubuntu and the user may; whether it did.
pub(crate) fn install_if_allowed(packages: &[&str]) -> anyhow::Result<bool> {
    match plan(&Facts { installed: false, ..gather() }) {
        Plan::Stop(_) => Ok(false),
        Plan::Install { sudo } => install(sudo, packages).map(|()| true),
    }
}

fn install(sudo: bool, packages: &[&str]) -> anyhow::Result<()> {
    let apt = |args: &[&str]| -> anyhow::Result<bool> {
        let mut command = Command::new(if sudo { "sudo" } else { "env" });
        if sudo {
            command.args(["-n", "env"]);
        }
        command.args(["DEBIAN_FRONTEND=noninteractive", "apt-get"]).args(args).stdin(Stdio::null());
        println!("$ apt-get {}", args.join(" "));
        Ok(command.status().context("cannot start apt-get")?.success())
    };
    // One unreachable source fails the update although the others suffice: only the install decides.
    if !apt(&["update"])? {
        println!("apt-get update failed; trying with the package lists that are there.");
    }
    let args = [&["install", "-y", "--no-install-recommends"][..], packages].concat();
    if !apt(&args)? {
        bail!("apt-get could not install {}; its output above says why", packages.join(" and "));
    }
    Ok(())
}

/// Runs this command again in place of this process.
fn start_over(runtime_dir: RuntimeDir) -> anyhow::Result<RuntimeDir> {
    println!("Installed. Starting over.");
    let program = std::env::current_exe().context("cannot find the running program")?;
    let mut command = Command::new(program);
    command.args(std::env::args_os().skip(1)).env(STARTED_OVER, "1");
    if runtime_dir.0.is_some() {
        command.env_remove("XDG_RUNTIME_DIR");
    }
    drop(runtime_dir);
    #[cfg(unix)]
    {
        use std::os::unix::process::CommandExt as _;
        Err(command.exec()).context("cannot start over")
    }
    #[cfg(not(unix))]
    {
        let status = command.status().context("cannot start over")?;
        std::process::exit(status.code().unwrap_or(1))
    }
}

/// A private `XDG_RUNTIME_DIR` where the session has none, so that Mesa does not complain about its
/// absence. The directory is removed on drop if it was made here.
pub(crate) struct RuntimeDir(Option<PathBuf>);

impl RuntimeDir {
    fn ensure() -> Self {
        if !cfg!(unix) || std::env::var_os("XDG_RUNTIME_DIR").is_some() {
            return Self(None);
        }
        let path = std::env::temp_dir().join(format!("antumbra-runtime-{}", std::process::id()));
        let mut builder = std::fs::DirBuilder::new();
        #[cfg(unix)]
        std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
        // Where it cannot be made, or is someone else's already, Mesa's complaint is harmless.
        if builder.create(&path).is_err() {
            return Self(None);
        }
        // SAFETY: `main` calls this first, before the process has a second thread.
        unsafe { std::env::set_var("XDG_RUNTIME_DIR", &path) };
        Self(Some(path))
    }
}

impl Drop for RuntimeDir {
    fn drop(&mut self) {
        if let Some(path) = self.0.take() {
            _ = std::fs::remove_dir_all(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEBIAN: &str = "PRETTY_NAME=\"Debian GNU/Linux 12\"\nID=debian\n";
    const MINT: &str = "ID=linuxmint\nID_LIKE=\"ubuntu debian\"\n";
    const FEDORA: &str = "ID=fedora\nPRETTY_NAME=\"Not debian\"\n";

    fn facts(os_release: &str) -> Facts {
        Facts { os: "linux".to_owned(), os_release: os_release.to_owned(), ..Facts::default() }
    }

    fn stop_message(facts: &Facts) -> String {
        match plan(facts) {
            Plan::Stop(message) => message,
            Plan::Install { .. } => panic!("must not install with {facts:?}"),
        }
    }

    #[test]
    fn installs_on_debian_and_its_family_where_the_user_may() {
        for release in [DEBIAN, MINT] {
            let root = Facts { root: true, ..facts(release) };
            assert_eq!(plan(&root), Plan::Install { sudo: false }, "root needs no sudo");
            let sudo = Facts { sudo: true, ..facts(release) };
            assert_eq!(plan(&sudo), Plan::Install { sudo: true }, "sudo without a password");
            let both = Facts { root: true, sudo: true, ..facts(release) };
            assert_eq!(plan(&both), Plan::Install { sudo: false }, "root needs no sudo");
        }
    }

    #[test]
    fn tells_the_command_where_the_user_may_not() {
        let message = stop_message(&facts(DEBIAN));
        assert!(message.contains("sudo apt-get install"), "{message}");
        for package in PACKAGES {
            assert!(message.contains(package), "{message} names {package}");
        }
    }

    #[test]
    fn never_installs_elsewhere() {
        let fedora = Facts { root: true, sudo: true, ..facts(FEDORA) };
        assert!(stop_message(&fedora).contains("dnf install"), "the system's own package manager");
        let unknown = Facts { root: true, ..facts("") };
        assert!(stop_message(&unknown).contains("lavapipe"), "names what to look for");
        let mac = Facts { os: "macos".to_owned(), root: true, ..Facts::default() };
        assert!(stop_message(&mac).contains("macos"), "no Linux package on another system");
    }

    #[test]
    fn installs_only_once() {
        let again = Facts { root: true, installed: true, ..facts(DEBIAN) };
        assert!(stop_message(&again).contains("VK_DRIVER_FILES"), "says what may hide the driver");
    }

    #[test]
    fn reads_quoted_and_plain_os_release_values() {
        assert_eq!(families(MINT), ["linuxmint", "ubuntu", "debian"], "ID and ID_LIKE only");
        assert_eq!(families("ID='ubuntu'\nVERSION_ID=\"24.04\"\n"), ["ubuntu"], "single quotes");
        assert!(families("nonsense").is_empty(), "no key, no family");
    }
}
