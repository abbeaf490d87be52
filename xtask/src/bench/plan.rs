//! What to measure: scenes, lights and techniques by name, with the suite's defaults.

use std::path::Path;

use antumbra::{Config, catalogue};
use antumbra_filter::{
    Esm, Evsm, Fallback, Footprint, Msm, MultipleDepth, PcfBilinearGrid, PcfCastano, PcfGrid,
    PcfPoisson, Prefilter as Filter, Savsm, Table, Vsm,
};
use antumbra_map::{MapConfig, Omni, Plain};
use antumbra_sampling::{CascadeFit, Cascades, Select};
use antumbra_scene::{LightKind, LoadOptions, Scene, generate, load};
use antumbra_soft::{
    Bitmask, Fusion, Occluders, OcclusionTextures, Pcss, Placement, Prefilter, SingleSample, Vssm,
    Widths, Window,
};
use antumbra_volume::{Savings, Silhouette, ZFail, ZPass};
use anyhow::{Context as _, bail};
use globset::Glob;

use super::{kernels, scaling};
use crate::args::{BenchArgs, Size, Suite};
use crate::results::Settings;

/// A technique under the name that tables show.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    /// `family/name`, with a suffix where the settings are not the defaults.
    pub(super) name: String,
    /// Its settings.
    pub(super) config: Config,
}

/// A scene to measure.
pub(super) struct Subject {
    /// The generated scene's name, or the file's path as given.
    pub(super) name: String,
    /// A short name for files, unique in the plan.
    pub(super) slug: String,
    /// The scene, with its ground.
    pub(super) scene: Scene,
    /// The techniques that it is for, of those that are measured; all where there is none.
    pub(super) only: &'static [&'static str],
}

/// Everything that will be measured, and how.
pub(super) struct Plan {
    pub(super) scenes: Vec<Subject>,
    pub(super) lights: Vec<LightKind>,
    pub(super) techniques: Vec<Entry>,
    pub(super) settings: Settings,
    pub(super) dump_mesh: bool,
}

/// Scenes of the quick suite: one shadow edge with a closed form, contacts, thin casters, a curved caster,
/// relief, an interior, and a large scene.
const QUICK_SCENES: [&str; 8] =
    ["half-plane", "sphere", "thin-wall", "fence", "tree", "terrain", "hall", "street"];
/// Techniques of the quick suite: the plain map, one that avoids its bias, what filters it, and what puts its samples
/// elsewhere. Shadow volumes of every triangle would take most of its time on a software device: ask for them by name.
pub(super) const QUICK_TECHNIQUES: [&str; 12] = [
    "map/plain",
    "map/midpoint",
    "filter/pcf-hardware",
    "filter/pcf-grid",
    "filter/pcf-bilinear-grid",
    "filter/pcf-castano",
    "filter/pcf-poisson",
    "filter/vsm",
    "filter/evsm",
    "filter/msm",
    "sampling/cascades",
    "sampling/view-samples",
];
/// Techniques of the scaling suite, beside those of the quick one: one map and what puts its samples elsewhere.
pub(super) const PLACED: [&str; 6] = [
    "map/plain",
    "sampling/lispsm",
    "sampling/cascades",
    "sampling/sdsm",
    "sampling/matched",
    "sampling/view-samples",
];
const HARD_LIGHTS: [LightKind; 3] = [LightKind::Directional, LightKind::Spot, LightKind::Point];

impl Plan {
    /// The plan for `args`. Names that are not known, patterns that match nothing and files that cannot be
    /// read are errors that list what there is.
    pub(super) fn new(args: &BenchArgs) -> anyhow::Result<Self> {
        let full = args.suite == Suite::Full;
        let side = if full { 512 } else { 256 };
        let size = args.size.unwrap_or(Size { width: side, height: side });
        let settings = Settings {
            suite: args.suite.to_string(),
            size: [size.width, size.height],
            map_size: args.map_size.unwrap_or(1024),
            light_samples: args.light_samples.unwrap_or(256),
            repeat: args.repeat.unwrap_or(if full { 9 } else { 5 }),
            ground: args.ground,
        };
        let lights = match (args.light.as_slice(), full) {
            ([], true) => LightKind::ALL.to_vec(),
            ([], false) => HARD_LIGHTS.to_vec(),
            (kinds, _) => kinds.to_vec(),
        };
        let mut techniques = select_techniques(&args.technique, args.suite)?;
        for technique in &mut techniques {
            technique.config.set_map_size(settings.map_size);
        }
        let scenes = match (args.suite, args.scene.as_slice()) {
            (Suite::Stability, []) => Vec::new(),
            (Suite::Stability, _) => {
                bail!("the stability suite has scenes of its own; leave out --scene")
            }
            (Suite::Scaling, []) => scaling::subjects(args.technique.is_empty()),
            _ => subjects(args, full)?,
        };
        Ok(Self { scenes, lights, techniques, settings, dump_mesh: args.dump_mesh })
    }
}

/// Prints every scene, light and technique there is.
pub(super) fn list() {
    println!("Scenes (or any .glb, .gltf, .obj, .toml file):");
    for (name, _, about) in all_generated() {
        println!("  {name:<24} {about}");
    }
    println!("Lights:");
    println!("  {}", LightKind::ALL.map(LightKind::name).join(", "));
    println!("Techniques (* in the quick suite):");
    for entry in entries() {
        let mark = if belongs(&entry, Suite::Quick) { "*" } else { " " };
        println!(" {mark}{}", entry.name);
    }
}

/// All generated scenes.
fn all_generated() -> impl Iterator<Item = &'static generate::Entry> {
    use generate::{ALL, CONVEX, CUT_OUT, TRANSLUCENT};
    ALL.iter().chain(CONVEX).chain(CUT_OUT).chain(TRANSLUCENT)
}

/// Every technique: the published defaults first, then the variants that the full suite adds.
fn entries() -> Vec<Entry> {
    let defaults =
        catalogue().into_iter().map(|config| Entry { name: config.id().to_owned(), config });
    let variant =
        |suffix: &str, config: Config| Entry { name: format!("{}-{suffix}", config.id()), config };
    let omni = |omni| MapConfig { omni, ..MapConfig::default() };
    let plain = |layout| Config::Plain(Plain { map: omni(layout) });
    let objects = MapConfig { objects: 8, ..MapConfig::default() };
    let masked = MapConfig { receiver_mask: true, ..MapConfig::default() };
    let grid = |layout| Config::PcfGrid(PcfGrid { map: omni(layout), ..Default::default() });
    let cascades = |fit, select| Config::Cascades(Cascades { fit, select, ..Default::default() });
    let over = |of| Config::Cascades(Cascades { of: Box::new(of), ..Default::default() });
    let one_tap = PcfBilinearGrid { side: 1, ..Default::default() };
    let castano =
        |side, hardware| Config::PcfCastano(PcfCastano { side, hardware, ..Default::default() });
    let bitmask = |occluders| Config::Bitmask(Bitmask { occluders, ..Default::default() });
    let named = Window { reach: 2, ..Window::default() };
    let two_layers_of_quads = Config::Bitmask(Bitmask {
        occluders: Occluders::Microquad,
        layers: 2,
        ..Default::default()
    });
    let slices = Config::OcclusionTextures;
    let uniform = OcclusionTextures { placement: Placement::Uniform, ..Default::default() };
    let error_driven = OcclusionTextures { placement: Placement::Error, ..Default::default() };
    let prefiltered =
        |prefilter| slices(OcclusionTextures { prefilter, ..OcclusionTextures::default() });
    let single =
        |widths, scale| Config::SingleSample(SingleSample { widths, scale, ..Default::default() });
    let of_pixels = Filter { footprint: Some(Footprint::default()), ..Default::default() };
    let of_samples = Filter { samples: 2, ..Default::default() };
    let fallback = |fallback| Config::Esm(Esm { fallback, ..Default::default() });
    defaults
        .chain([
            variant("receiver-mask", Config::Plain(Plain { map: masked })),
            variant("objects", Config::Plain(Plain { map: objects })),
            variant("tetrahedron", plain(Omni::Tetrahedron)),
            variant("isocube", plain(Omni::Isocube)),
            variant("paraboloid", plain(Omni::DualParaboloid)),
            variant("paraboloid-warped", plain(Omni::WarpedParaboloid)),
            variant("tetrahedron", grid(Omni::Tetrahedron)),
            variant("isocube", grid(Omni::Isocube)),
            variant("paraboloid", grid(Omni::DualParaboloid)),
            variant("5", Config::PcfGrid(PcfGrid { side: 5, ..Default::default() })),
            variant("7", Config::PcfGrid(PcfGrid { side: 7, ..Default::default() })),
            variant("1", Config::PcfBilinearGrid(one_tap)),
            variant(
                "5",
                Config::PcfBilinearGrid(PcfBilinearGrid { side: 5, ..Default::default() }),
            ),
            variant("3", castano(3, false)),
            variant("7", castano(7, false)),
            variant("3-hw", castano(3, true)),
            variant("5-hw", castano(5, true)),
            variant("7-hw", castano(7, true)),
            variant("32", Config::PcfPoisson(PcfPoisson { taps: 32, ..Default::default() })),
            variant("all", Config::Pcss(Pcss { search: 0, filter: 0, ..Default::default() })),
            variant("micropatch", bitmask(Occluders::Micropatch)),
            variant("microquad", bitmask(Occluders::Microquad)),
            variant("exact", bitmask(Occluders::ExactMicroquad)),
            variant("microtri", bitmask(Occluders::Microtri)),
            variant("named", Config::Bitmask(Bitmask { window: named, ..Default::default() })),
            variant("named", Config::Pcss(Pcss { window: named, ..Default::default() })),
            variant("named", Config::Vssm(Vssm { reach: 2, ..Default::default() })),
            variant("two-layers", Config::Bitmask(Bitmask { layers: 2, ..Default::default() })),
            variant("microquad-two-layers", two_layers_of_quads),
            variant("16", slices(OcclusionTextures { slices: 16, ..Default::default() })),
            variant("24", slices(OcclusionTextures { slices: 24, ..Default::default() })),
            variant("uniform", slices(uniform)),
            variant("error", slices(error_driven)),
            variant("tally", slices(OcclusionTextures { tally: true, ..Default::default() })),
            variant("sum", slices(OcclusionTextures { fusion: Fusion::Sum, ..Default::default() })),
            variant("max", slices(OcclusionTextures { fusion: Fusion::Max, ..Default::default() })),
            variant("n-buffer", prefiltered(Prefilter::NBuffer)),
            variant("mip", prefiltered(Prefilter::Mip)),
            variant("euclidean", single(Widths::Euclidean, 1.0)),
            variant("city-block", single(Widths::CityBlock, 1.0)),
            variant("harder", single(Widths::Doubling, 2.0)),
            variant("footprint", Config::Vsm(Vsm { filter: of_pixels, ..Default::default() })),
            variant("footprint", Config::Evsm(Evsm { filter: of_pixels, ..Default::default() })),
            variant("footprint", Config::Msm(Msm { filter: of_pixels, ..Default::default() })),
            variant("samples", Config::Vsm(Vsm { filter: of_samples, ..Default::default() })),
            variant("samples", Config::Msm(Msm { filter: of_samples, ..Default::default() })),
            variant("overflow", fallback(Fallback::Overflow)),
            variant("deeper", fallback(Fallback::Deeper)),
            variant(
                "n-buffer",
                Config::MultipleDepth(MultipleDepth { n_buffer: true, ..Default::default() }),
            ),
            variant("ends", Config::Msm(Msm { ends: true, ..Default::default() })),
            variant("float", Config::Savsm(Savsm { table: Table::Float, ..Default::default() })),
            variant("tight", cascades(CascadeFit::Tight, Select::Map)),
            variant("warped", cascades(CascadeFit::Warped, Select::Map)),
            variant("by-depth", cascades(CascadeFit::Steady, Select::Depth)),
            variant("pcf", over(Config::PcfBilinearGrid(one_tap))),
            variant("pcss", over(Config::Pcss(Pcss::default()))),
            variant("bitmask", over(Config::Bitmask(Bitmask::default()))),
        ])
        .chain(savings())
        .collect()
}

/// What is saved of volumes, each alone and all together; those that end in `tally` count fragments, too.
fn savings() -> impl Iterator<Item = Entry> {
    let none = Savings::default();
    let window = Savings { window: true, ..none };
    let litmap = Savings { litmap: 256, ..window };
    let all = [
        ("tally", none),
        ("unculled-tally", none),
        ("window-tally", window),
        ("slices-tally", Savings { slices: 16, ..window }),
        ("near-tally", Savings { near: true, ..none }),
        ("far-tally", Savings { far: true, ..none }),
        ("litmap-tally", litmap),
        ("hidden-tally", Savings { hidden: true, ..litmap }),
        ("clamped-tally", Savings::ALL),
        ("window", window),
        ("hidden", Savings { hidden: true, ..litmap }),
        ("unculled", none),
        ("clamped", Savings::ALL),
    ];
    // Beside z-fail as it is: what counts in front may leave nothing away.
    let in_front = ["unculled", "unculled-tally"].into_iter().map(move |suffix| {
        let savings = Savings { tally: suffix.ends_with("tally"), ..none };
        let config = Config::VolumeZPass(ZPass { savings, ..Default::default() });
        Entry { name: format!("{}-{suffix}", config.id()), config }
    });
    let behind = all.into_iter().flat_map(|(suffix, savings)| {
        let savings = Savings { tally: suffix.ends_with("tally"), ..savings };
        let culling = !suffix.starts_with("unculled");
        let volumes = [
            Config::VolumeZFail(ZFail { savings, culling, ..Default::default() }),
            Config::VolumeSilhouette(Silhouette { savings, culling, ..Default::default() }),
        ];
        volumes.map(|config| Entry { name: format!("{}-{suffix}", config.id()), config })
    });
    behind.chain(in_front)
}

/// Whether a suite runs the technique where none is asked for.
fn belongs(entry: &Entry, suite: Suite) -> bool {
    match suite {
        Suite::Full => true,
        Suite::Stability => entry.name == entry.config.id(),
        Suite::Quick => QUICK_TECHNIQUES.contains(&entry.name.as_str()),
        Suite::Scaling => {
            let name = entry.name.as_str();
            belongs(entry, Suite::Quick)
                || PLACED.contains(&name)
                || kernels::TECHNIQUES.contains(&name)
        }
    }
}

/// The techniques that match any of `patterns`; without a pattern, those of the suite.
fn select_techniques(patterns: &[String], suite: Suite) -> anyhow::Result<Vec<Entry>> {
    let all = entries();
    if patterns.is_empty() {
        return Ok(all.into_iter().filter(|e| belongs(e, suite)).collect());
    }
    let mut wanted = vec![false; all.len()];
    for pattern in patterns {
        let glob = Glob::new(pattern)
            .with_context(|| format!("`{pattern}` is not a pattern"))?
            .compile_matcher();
        let mut any = false;
        for (entry, wanted) in all.iter().zip(&mut wanted) {
            if glob.is_match(&entry.name) {
                (*wanted, any) = (true, true);
            }
        }
        if !any {
            let names: Vec<_> = all.iter().map(|e| e.name.as_str()).collect();
            bail!("no technique matches `{pattern}`; there are: {}", names.join(", "));
        }
    }
    Ok(all.into_iter().zip(wanted).filter_map(|(e, wanted)| wanted.then_some(e)).collect())
}

fn subjects(args: &BenchArgs, full: bool) -> anyhow::Result<Vec<Subject>> {
    let names: Vec<String> = match (args.scene.as_slice(), full) {
        ([], true) => generate::ALL.iter().map(|(name, ..)| (*name).to_owned()).collect(),
        ([], false) => QUICK_SCENES.map(str::to_owned).to_vec(),
        (given, _) => given.to_vec(),
    };
    let mut subjects: Vec<Subject> = Vec::new();
    for name in names {
        let (scene, stem) = open_scene(&name, args.ground)?;
        let taken = subjects.iter().filter(|s| s.slug.starts_with(&stem)).count();
        let slug = if taken == 0 { stem } else { format!("{stem}~{taken}") };
        subjects.push(Subject { name, slug, scene, only: &[] });
    }
    Ok(subjects)
}

/// A generated scene by name, or a scene file.
fn open_scene(name: &str, ground: bool) -> anyhow::Result<(Scene, String)> {
    let generated = generate::by_name(name);
    let path = Path::new(name);
    let known_ending = path
        .extension()
        .and_then(|e| e.to_str())
        .is_some_and(|e| ["glb", "gltf", "obj", "toml"].contains(&e.to_lowercase().as_str()));
    let (mut scene, stem) = match generated {
        Some(scene) => (scene, name.to_owned()),
        None if known_ending || path.exists() => {
            let (scene, repairs) = load(path, &LoadOptions::default())?;
            if !repairs.is_empty() {
                println!("{name}: {repairs}");
            }
            let stem = path.file_stem().map_or_else(|| "scene".into(), |s| s.to_string_lossy());
            (scene, stem.into_owned())
        }
        None => {
            let names: Vec<_> = all_generated().map(|(name, ..)| *name).collect();
            bail!(
                "no scene `{name}`; name a .glb, .gltf, .obj or .toml file, or one of: {}",
                names.join(", ")
            );
        }
    };
    if ground {
        scene.add_ground();
    }
    let safe = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    Ok((scene, stem.chars().map(safe).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_techniques_are_unique() {
        let mut names: Vec<_> = entries().into_iter().map(|e| e.name).collect();
        let count = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), count, "two techniques share a name");
    }

    #[test]
    fn patterns_select_and_unknown_ones_list_what_there_is() {
        let some = select_techniques(
            &["map/plain".into(), "filter/pcf-grid".into(), "filter/pcf-grid-?".into()],
            Suite::Quick,
        )
        .expect("patterns that match");
        let names: Vec<_> = some.iter().map(|e| e.name.as_str()).collect();
        assert_eq!(
            names,
            ["map/plain", "filter/pcf-grid", "filter/pcf-grid-5", "filter/pcf-grid-7"],
            "in the catalogue's order"
        );
        let error =
            select_techniques(&["soft/none".into()], Suite::Quick).expect_err("no such technique");
        assert!(error.to_string().contains("map/plain"), "{error}");
    }

    #[test]
    fn unknown_scenes_list_the_known_ones() {
        let error = open_scene("nowhere", false).expect_err("no such scene");
        assert!(error.to_string().contains("half-plane"), "{error}");
        let error = open_scene("missing.glb", false).expect_err("no such file");
        assert!(format!("{error:#}").contains("missing.glb"), "{error:#}");
    }

    #[test]
    fn every_quick_technique_exists() {
        let quick = select_techniques(&[], Suite::Quick).expect("no pattern, no error");
        let names: Vec<_> = quick.iter().map(|e| e.name.as_str()).collect();
        assert_eq!(names.len(), QUICK_TECHNIQUES.len(), "{names:?}");
    }

    #[test]
    fn every_technique_of_the_scaling_suite_exists() {
        let scaling = select_techniques(&[], Suite::Scaling).expect("no pattern, no error");
        for name in PLACED {
            assert!(scaling.iter().any(|e| e.name == name), "{name}");
        }
    }

    #[test]
    fn every_quick_scene_exists() {
        for name in QUICK_SCENES {
            assert!(generate::by_name(name).is_some(), "{name}");
        }
    }
}
