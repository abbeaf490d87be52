//! Chores of the Antumbra workspace: `cargo xtask bench`, `report`, `shaders` and `test`.

#![allow(clippy::print_stdout, reason = "a command-line tool prints")]

mod args;
mod baseline;
mod bench;
mod columns;
mod doc;
mod exr;
mod outcome;
mod provision;
mod report;
mod results;
#[cfg(test)]
mod sample;
mod shaders;
mod table;
mod test;
mod validation;

use std::process::ExitCode;

use clap::Parser as _;

use args::{Cli, Command, ShaderCommand};

fn main() -> ExitCode {
    match run(Cli::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Bench(args) => {
            // A list needs no GPU.
            let _runtime_dir = (!args.list).then(provision::ensure_adapter).transpose()?;
            bench::run(args)
        }
        Command::Doc { check, measure, draw } => {
            let draws = draw.is_some() || !measure.is_empty();
            let _runtime_dir = draws.then(provision::ensure_adapter).transpose()?;
            measure.iter().try_for_each(|file| doc::measure(file))?;
            draw.iter().try_for_each(|names| doc::draw(names))?;
            doc::run(check)
        }
        Command::Report { dir } => report::run(&dir),
        Command::Shaders { command: ShaderCommand::Export { to, dir } } => {
            shaders::export(to, &dir)
        }
        Command::Shaders { command: ShaderCommand::Check } => shaders::check(),
        Command::Test { only } => {
            let steps = test::steps(&only);
            // The others only build and read.
            let draws =
                steps.iter().any(|s| [test::Step::Test, test::Step::Validation].contains(s));
            let _runtime_dir = draws.then(provision::ensure_adapter).transpose()?;
            test::run(&steps)
        }
    }
}
