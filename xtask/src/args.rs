//! The command line.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use antumbra_scene::LightKind;
use clap::{Args, Parser, Subcommand, ValueEnum};

use crate::test::Step;

/// Chores of the Antumbra workspace.
#[derive(Debug, Parser)]
#[command(bin_name = "cargo xtask")]
pub(crate) struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Measure speed and error of shadow techniques against ground truth
    Bench(BenchArgs),
    /// Fill what is measured on the pages of the documentation: tables from docs/results, pictures
    Doc {
        /// Fail where a table is out of date instead of writing it
        #[arg(long, conflicts_with = "measure")]
        check: bool,

        /// Measure these results again first: the same scenes, lights, techniques and settings
        #[arg(long, value_name = "results.json", num_args = 1..)]
        measure: Vec<PathBuf>,

        /// Draw the pictures of the pages whose name contains one of these words first, or of all
        #[arg(long, value_name = "WORD", num_args = 0.., conflicts_with = "check")]
        draw: Option<Vec<String>>,
    },
    /// Write index.html again from the results.json of an earlier bench
    Report {
        /// Directory of the earlier bench
        dir: PathBuf,
    },
    /// Export or validate the shaders
    Shaders {
        /// What to do with them
        #[command(subcommand)]
        command: ShaderCommand,
    },
    /// Run everything that CI runs
    Test {
        /// Run only these steps
        #[arg(long, value_enum, value_delimiter = ',')]
        only: Vec<Step>,
    },
}

/// What to do with the shaders.
#[derive(Debug, Subcommand)]
pub(crate) enum ShaderCommand {
    /// Write every shader permutation in another shading language
    Export {
        /// Language to write
        #[arg(long, value_enum)]
        to: ShaderLanguage,
        /// Directory to write into; made if it is not there
        dir: PathBuf,
    },
    /// Link and validate every shader permutation
    Check,
}

/// A language that shaders can be exported to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ShaderLanguage {
    /// WebGPU Shading Language, plain
    Wgsl,
    /// SPIR-V binaries
    Spirv,
    /// Metal Shading Language
    Msl,
    /// High-Level Shading Language
    Hlsl,
    /// OpenGL Shading Language
    Glsl,
}

/// What to measure. Unset options get the suite's defaults.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct BenchArgs {
    /// Generated scene by name, or file (.glb, .gltf, .obj, .toml); repeatable
    #[arg(long, value_name = "NAME|FILE")]
    pub(crate) scene: Vec<String>,

    /// Add a ground plane under scenes from files
    #[arg(long)]
    pub(crate) ground: bool,

    /// Kind of light, placed from the scene's bounds or taken from its file; repeatable
    #[arg(long, value_name = "KIND", value_delimiter = ',', value_parser = light_kind)]
    pub(crate) light: Vec<LightKind>,

    /// Techniques by name or pattern, such as filter/pcf-*; repeatable
    #[arg(long, value_name = "GLOB", value_delimiter = ',')]
    pub(crate) technique: Vec<String>,

    /// Width and height of the view, in view samples
    #[arg(long, value_name = "WxH")]
    pub(crate) size: Option<Size>,

    /// Side of the shadow map, texels
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=16384))]
    pub(crate) map_size: Option<u32>,

    /// Light samples per view sample of the reference, for lights with an extent
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub(crate) light_samples: Option<u32>,

    /// What to run where no option says otherwise
    #[arg(long, value_enum, default_value_t)]
    pub(crate) suite: Suite,

    /// Directory for results.json, results.csv, index.html and the raw images
    #[arg(long, value_name = "DIR", default_value = "bench-out")]
    pub(crate) out: PathBuf,

    /// Earlier results to compare with; regressions make the command fail
    #[arg(long, value_name = "results.json")]
    pub(crate) baseline: Option<PathBuf>,

    /// Write each scene's triangles as one OBJ file in world space
    #[arg(long)]
    pub(crate) dump_mesh: bool,

    /// List scenes, lights and techniques, and stop
    #[arg(long)]
    pub(crate) list: bool,

    /// Interleaved repetitions of each timing
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub(crate) repeat: Option<u32>,

    /// Part of the adapter's name, any case; without it, wgpu's choice
    #[arg(long, value_name = "NAME")]
    pub(crate) adapter: Option<String>,
}

/// A set of runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum Suite {
    /// Minutes: a few telling scenes
    #[default]
    Quick,
    /// Every generated scene, light and technique
    Full,
    /// The hard cases, each against its expected behaviour
    Stability,
    /// Error and time against map size and other parameters
    Scaling,
}

impl fmt::Display for Suite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Quick => "quick",
            Self::Full => "full",
            Self::Stability => "stability",
            Self::Scaling => "scaling",
        })
    }
}

/// Width and height in view samples, written `640x360`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Size {
    /// View samples per row.
    pub(crate) width: u32,
    /// Rows.
    pub(crate) height: u32,
}

impl FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let side = |s: &str| s.parse::<u32>().ok().filter(|n| (1..=16384).contains(n));
        text.split_once(['x', 'X', '×'])
            .and_then(|(w, h)| Some(Self { width: side(w)?, height: side(h)? }))
            .ok_or_else(|| "give two numbers from 1 to 16384, as in 640x360".to_owned())
    }
}

fn light_kind(text: &str) -> Result<LightKind, String> {
    LightKind::ALL.into_iter().find(|k| k.name() == text).ok_or_else(|| {
        let known = LightKind::ALL.map(LightKind::name).join(", ");
        format!("known kinds are {known}")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bench(args: &str) -> Result<BenchArgs, String> {
        let words = ["cargo xtask", "bench"].into_iter().chain(args.split_whitespace());
        match Cli::try_parse_from(words).map_err(|e| e.to_string())?.command {
            Command::Bench(args) => Ok(args),
            other => Err(format!("parsed as {other:?}")),
        }
    }

    #[test]
    fn definition_is_consistent() {
        use clap::CommandFactory as _;
        Cli::command().debug_assert();
    }

    #[test]
    fn lists_repeat_and_split_at_commas() {
        let args = bench("--scene a --scene b,c.obj --light spot,point --light rect --technique map/*,filter/pcf-*")
            .expect("parses");
        assert_eq!(args.scene, ["a", "b,c.obj"], "a file's name may hold a comma");
        assert_eq!(args.light, [LightKind::Spot, LightKind::Point, LightKind::Rect], "kinds");
        assert_eq!(args.technique, ["map/*", "filter/pcf-*"], "patterns");
    }

    #[test]
    fn sizes_and_names_that_make_no_sense_say_what_would() {
        assert_eq!(
            bench("--size 640x360").expect("parses").size,
            Some(Size { width: 640, height: 360 }),
            "width first"
        );
        for bad in ["640", "0x10", "10x-1", "x", "99999x1"] {
            let message = bench(&format!("--size {bad}")).expect_err("no size");
            assert!(message.contains("640x360"), "{message}");
        }
        let message = bench("--light lamp").expect_err("no kind");
        assert!(message.contains("directional"), "lists the known kinds: {message}");
        assert!(bench("--map-size 0").is_err(), "an empty map");
        assert!(bench("--repeat 0").is_err(), "no repetition");
    }
}
