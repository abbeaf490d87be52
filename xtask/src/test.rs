//! `cargo xtask test`: everything that CI runs, in order, stopping at the first failure.

use std::ffi::OsString;
use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use clap::ValueEnum;

use crate::{doc, shaders, validation};

/// One step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Step {
    /// Formatting.
    Fmt,
    /// Lints, as errors.
    Clippy,
    /// Unit, integration and documentation tests.
    Test,
    /// Every shader permutation, linked and validated.
    Shaders,
    /// A bench under the Khronos validation layer, where there is Vulkan.
    Validation,
    /// Measured tables of the documentation, up to date with the committed results.
    Tables,
    /// Documentation, with warnings as errors.
    Doc,
}

impl Step {
    const ALL: [Self; 7] = [
        Self::Fmt,
        Self::Clippy,
        Self::Test,
        Self::Shaders,
        Self::Validation,
        Self::Tables,
        Self::Doc,
    ];

    /// The arguments to cargo, or `None` for a step that is not cargo's.
    fn cargo_args(self) -> Option<&'static str> {
        match self {
            Self::Fmt => Some("fmt --all --check"),
            Self::Clippy => Some("clippy --release --workspace --all-targets -- -D warnings"),
            Self::Test => Some("test --release --workspace"),
            Self::Shaders | Self::Validation | Self::Tables => None,
            Self::Doc => Some("doc --release --workspace --no-deps"),
        }
    }

    /// The rustup component that the step needs beyond cargo.
    fn component(self) -> Option<&'static str> {
        match self {
            Self::Fmt => Some("rustfmt"),
            Self::Clippy => Some("clippy"),
            Self::Test | Self::Shaders | Self::Validation | Self::Tables | Self::Doc => None,
        }
    }

    fn title(self) -> String {
        match self {
            Self::Shaders => "cargo xtask shaders check".to_owned(),
            Self::Validation => "cargo xtask bench, under the Vulkan validation layer".to_owned(),
            Self::Tables => "cargo xtask doc --check".to_owned(),
            _ => format!("cargo {}", self.cargo_args().unwrap_or_default()),
        }
    }

    fn run(self) -> anyhow::Result<()> {
        let Some(args) = self.cargo_args() else {
            return match self {
                Self::Validation => validation::run(),
                Self::Tables => doc::run(true),
                _ => shaders::check(),
            };
        };
        let mut command = cargo();
        command.args(args.split(' '));
        if self == Self::Doc {
            command.env("RUSTDOCFLAGS", "-D warnings");
        }
        let status = command.status().context("cannot start cargo")?;
        if !status.success() {
            bail!("`cargo {args}` failed ({status})");
        }
        Ok(())
    }
}

/// The cargo that runs this program, or the one on the path.
fn cargo() -> Command {
    Command::new(std::env::var_os("CARGO").unwrap_or_else(|| OsString::from("cargo")))
}

/// The steps `only`, or all of them, in their fixed order.
pub(crate) fn steps(only: &[Step]) -> Vec<Step> {
    Step::ALL.into_iter().filter(|s| only.is_empty() || only.contains(s)).collect()
}

/// Runs `steps`, and says at the end what ran and how long it took.
pub(crate) fn run(steps: &[Step]) -> anyhow::Result<()> {
    require_components(steps)?;
    let (done, failure) = run_steps(steps, |step| {
        println!("\n== {}", step.title());
        step.run()
    });
    print!("{}", summary(steps, &done, failure.is_some()));
    failure.map_or(Ok(()), Err)
}

/// Stops before the first step if a later one could not run.
fn require_components(steps: &[Step]) -> anyhow::Result<()> {
    let missing: Vec<&str> = steps
        .iter()
        .filter(|step| step.component().is_some())
        .filter(|step| {
            let subcommand = if **step == Step::Fmt { "fmt" } else { "clippy" };
            !cargo().args([subcommand, "--version"]).output().is_ok_and(|o| o.status.success())
        })
        .filter_map(|step| step.component())
        .collect();
    if !missing.is_empty() {
        bail!("this needs: rustup component add {}", missing.join(" "));
    }
    Ok(())
}

/// Runs `steps` until one fails; returns how long each took, the failed one last.
fn run_steps(
    steps: &[Step],
    mut run: impl FnMut(Step) -> anyhow::Result<()>,
) -> (Vec<Duration>, Option<anyhow::Error>) {
    let mut done = Vec::new();
    for &step in steps {
        let start = Instant::now();
        let result = run(step);
        done.push(start.elapsed());
        if let Err(error) = result {
            return (done, Some(error));
        }
    }
    (done, None)
}

fn summary(steps: &[Step], done: &[Duration], failed: bool) -> String {
    let mut text = String::from("\n");
    for (i, step) in steps.iter().enumerate() {
        let outcome = match done.get(i) {
            None => "not run".to_owned(),
            Some(t) if failed && i + 1 == done.len() => {
                format!("FAILED  {:7.1} s", t.as_secs_f64())
            }
            Some(t) => format!("ok      {:7.1} s", t.as_secs_f64()),
        };
        text += &format!("{outcome:18} {}\n", step.title());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stops_at_the_first_failure_and_says_what_was_not_run() {
        let mut ran = Vec::new();
        let (done, failure) = run_steps(&Step::ALL, |step| {
            ran.push(step);
            if step == Step::Clippy { Err(anyhow::anyhow!("a lint")) } else { Ok(()) }
        });
        assert_eq!(ran, [Step::Fmt, Step::Clippy], "nothing runs after the failure");
        assert!(failure.is_some(), "the failure is handed on");
        let text = summary(&Step::ALL, &done, true);
        let outcomes: Vec<&str> = text.lines().skip(1).map(|l| &l[..6]).collect();
        let (ran, rest) = outcomes.split_at(2);
        assert_eq!(ran, ["ok    ", "FAILED"], "{text}");
        assert_eq!(rest.len(), Step::ALL.len() - 2, "{text}");
        assert!(rest.iter().all(|outcome| *outcome == "not ru"), "{text}");
    }

    #[test]
    fn reports_success_for_every_step() {
        let (done, failure) = run_steps(&Step::ALL, |_| Ok(()));
        assert!(failure.is_none(), "no failure");
        let text = summary(&Step::ALL, &done, false);
        assert_eq!(text.matches("ok ").count(), Step::ALL.len(), "{text}");
    }
}
