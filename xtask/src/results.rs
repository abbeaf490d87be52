//! The schema of `results.json` (`docs/results-schema.md`), its CSV twin, and how both are read
//! and written.
//!
//! A number that could not be measured is `null` in JSON, `None` here and an empty cell in CSV:
//! it is never zero and never NaN.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::Path;

use antumbra_reference::Metrics;
use antumbra_scene::Light;
use anyhow::{Context as _, bail};
use serde::{Deserialize, Serialize};

use crate::columns;

/// The version of the schema that this build writes, and the only one that it reads.
pub(crate) const SCHEMA: u32 = 1;

/// One bench: everything `results.json` holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Results {
    /// [`SCHEMA`].
    pub(crate) schema: u32,
    /// The GPU that ran it.
    pub(crate) adapter: Adapter,
    /// What was asked for and holds for all runs.
    pub(crate) settings: Settings,
    /// One entry per scene, light and technique, in the order in which they were asked for.
    pub(crate) runs: Vec<Run>,
    /// The hard cases; empty unless the stability suite ran.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) stability: Vec<StabilityCase>,
    /// Error and time against a parameter; empty unless the scaling suite ran.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) scaling: Vec<ScalingCurve>,
}

/// The GPU, its driver and the API between.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Adapter {
    /// The device's name, as the driver gives it.
    pub(crate) name: String,
    /// `vulkan`, `metal`, `dx12`, …
    pub(crate) backend: String,
    /// `DiscreteGpu`, `IntegratedGpu`, `VirtualGpu`, `Cpu` or `Other`.
    pub(crate) device_type: String,
    /// The driver's name.
    pub(crate) driver: String,
    /// The driver's version.
    pub(crate) driver_info: String,
}

impl From<&wgpu::AdapterInfo> for Adapter {
    fn from(info: &wgpu::AdapterInfo) -> Self {
        Self {
            name: info.name.clone(),
            backend: info.backend.to_string(),
            device_type: format!("{:?}", info.device_type),
            driver: info.driver.clone(),
            driver_info: info.driver_info.clone(),
        }
    }
}

/// What was asked for and holds for all runs.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Settings {
    /// `quick`, `full`, `stability` or `scaling`.
    pub(crate) suite: String,
    /// Width and height of the view, in view samples.
    pub(crate) size: [u32; 2],
    /// Side of the shadow map, texels.
    pub(crate) map_size: u32,
    /// Light samples of the reference for lights with an extent.
    pub(crate) light_samples: u32,
    /// Interleaved repetitions of each timing.
    pub(crate) repeat: u32,
    /// Whether scenes from files stand on a ground.
    #[serde(default)]
    pub(crate) ground: bool,
}

/// One technique on one scene under one light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Run {
    /// The generated scene's name, or the file's path as given.
    pub(crate) scene: String,
    /// The light, in world space.
    pub(crate) light: Light,
    /// `family/name`.
    pub(crate) technique: String,
    /// The technique's config.
    pub(crate) config: serde_json::Value,
    /// How it ended. Everything below is `null` or empty where it did not get that far.
    pub(crate) status: Status,
    /// How wrong.
    pub(crate) error: Option<Metrics>,
    /// How fast.
    pub(crate) time: Option<Time>,
    /// Deterministic work counters, by name.
    #[serde(default)]
    pub(crate) work: BTreeMap<String, u64>,
    /// Bytes of GPU memory that the technique holds.
    pub(crate) bytes: Option<u64>,
    /// What the truth is made of.
    pub(crate) reference: Option<Reference>,
    /// Raw images, paths relative to the JSON file.
    #[serde(default)]
    pub(crate) files: Files,
}

/// How a run ended; `"ok"`, `"failed: …"` or `"skipped: …"` in files.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub(crate) enum Status {
    /// Measured.
    Ok,
    /// Went wrong, with the reason.
    Failed(String),
    /// Was not tried, with the reason.
    Skipped(String),
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ok => f.write_str("ok"),
            Self::Failed(why) => write!(f, "failed: {why}"),
            Self::Skipped(why) => write!(f, "skipped: {why}"),
        }
    }
}

impl From<Status> for String {
    fn from(status: Status) -> Self {
        status.to_string()
    }
}

impl TryFrom<String> for Status {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        if text == "ok" {
            Ok(Self::Ok)
        } else if let Some(why) = text.strip_prefix("failed: ") {
            Ok(Self::Failed(why.to_owned()))
        } else if let Some(why) = text.strip_prefix("skipped: ") {
            Ok(Self::Skipped(why.to_owned()))
        } else {
            Err(format!("status {text:?} is none of \"ok\", \"failed: …\", \"skipped: …\""))
        }
    }
}

/// How long a run took.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Time {
    /// GPU milliseconds of one frame's shadows, over the repetitions.
    pub(crate) gpu_ms: Option<Spread>,
    /// Median CPU milliseconds to record one frame's commands.
    pub(crate) cpu_ms: Option<f64>,
    /// Median GPU time over that of `map/plain` in the same group and the same run of the bench.
    pub(crate) ratio_to_plain: Option<f64>,
}

/// Median and extremes of repeated measurements.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Spread {
    /// Median.
    pub(crate) median: f64,
    /// Smallest.
    pub(crate) min: f64,
    /// Largest.
    pub(crate) max: f64,
}

impl Spread {
    /// Median and extremes of `samples`; `None` if there is none or one is not finite.
    pub(crate) fn of(samples: &[f64]) -> Option<Self> {
        if samples.is_empty() || samples.iter().any(|s| !s.is_finite()) {
            return None;
        }
        let mut sorted = samples.to_vec();
        sorted.sort_by(f64::total_cmp);
        let n = sorted.len();
        let median = 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]);
        Some(Self { median, min: sorted[0], max: sorted[n - 1] })
    }
}

/// Where the truth comes from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Reference {
    /// `ray-traced` or `closed-form`.
    pub(crate) kind: String,
    /// Light samples per view sample; 1 for a light without extent.
    pub(crate) light_samples: u32,
    /// The reference's own estimate of its RMSE.
    pub(crate) error_estimate: Option<f64>,
}

/// Raw images of a run: float32 EXR, except the PNG. Paths are relative to the JSON file.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Files {
    /// The technique's visibility, channel Y.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) visibility: Option<String>,
    /// The true visibility, channel Y.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) reference: Option<String>,
    /// RGB world position; A = 1 where the sample exists and counts, else 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) position: Option<String>,
    /// RGB geometric normal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) normal: Option<String>,
    /// A shaded picture for people, PNG.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) shaded: Option<String>,
    /// The scene's triangles in world space, OBJ, with `--dump-mesh`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) mesh: Option<String>,
}

/// One technique on one hard case.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct StabilityCase {
    /// The case's name.
    pub(crate) case: String,
    /// What the case tests.
    pub(crate) about: String,
    /// What its number is, with the unit.
    pub(crate) number: String,
    /// `family/name`.
    pub(crate) technique: String,
    /// What theory says.
    pub(crate) expected: Expected,
    /// Why it fails, in one sentence: a known limit, or what kept it from being measured.
    pub(crate) reason: String,
    /// Smallest number expected of a known limit.
    pub(crate) at_least: Option<f64>,
    /// Largest number expected.
    pub(crate) bound: Option<f64>,
    /// What was measured.
    pub(crate) measured: Option<f64>,
    /// Whether it behaved as expected; an unexpected success is `false` too. `None` where it was measured and nobody
    /// has said what to expect.
    pub(crate) pass: Option<bool>,
}

impl StabilityCase {
    /// Whether it did not behave as expected, or could not be measured.
    pub(crate) fn is_surprise(&self) -> bool {
        self.pass == Some(false)
    }
}

/// What theory says of a technique on a hard case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Expected {
    /// It holds, within the bound.
    Holds,
    /// It fails, within the bound.
    KnownLimit,
    /// It answers with an error.
    Refuses,
    /// Nobody has said yet: what is measured is shown and not judged.
    Unsaid,
}

/// Error and time of one technique against one parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct ScalingCurve {
    /// As in [`Run`].
    pub(crate) scene: String,
    /// As in [`Run`].
    pub(crate) light: Light,
    /// As in [`Run`].
    pub(crate) technique: String,
    /// What changes: `map_size`, `light_samples`, `triangles`, …
    pub(crate) parameter: String,
    /// By increasing value.
    pub(crate) points: Vec<ScalingPoint>,
}

/// One point of a [`ScalingCurve`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct ScalingPoint {
    /// The parameter.
    pub(crate) value: f64,
    /// Mean absolute error.
    pub(crate) mean_abs: Option<f64>,
    /// Root mean square error.
    pub(crate) rmse: Option<f64>,
    /// Median GPU milliseconds.
    pub(crate) gpu_ms: Option<f64>,
    /// Bytes held.
    pub(crate) bytes: Option<u64>,
    /// Work counters, which are the same in every run.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) work: BTreeMap<String, u64>,
}

/// A light in a few words: its kind and the numbers that tell it from others of its kind.
pub(crate) fn describe_light(light: &Light) -> String {
    let kind = light.kind().name();
    match light {
        Light::Directional { angular_diameter, .. } if *angular_diameter > 0.0 => {
            format!("{kind} {:.2}°", angular_diameter.to_degrees())
        }
        Light::Spot { outer_angle, .. } => format!("{kind} ±{:.0}°", outer_angle.to_degrees()),
        Light::Sphere { radius, .. } | Light::Disc { radius, .. } => {
            format!("{kind} r={radius:.3} m")
        }
        Light::Rect { half_u, half_v, .. } => {
            format!("{kind} {:.3} × {:.3} m", 2.0 * half_u.length(), 2.0 * half_v.length())
        }
        Light::Directional { .. } | Light::Point { .. } => kind.to_owned(),
    }
}

impl Results {
    /// The runs of each scene and light, in order of first appearance.
    pub(crate) fn groups(&self) -> Vec<Vec<&Run>> {
        let mut groups: Vec<Vec<&Run>> = Vec::new();
        for run in &self.runs {
            match groups.iter_mut().find(|g| g[0].scene == run.scene && g[0].light == run.light) {
                Some(group) => group.push(run),
                None => groups.push(vec![run]),
            }
        }
        groups
    }

    /// Reads `results.json`. A file that is missing, is no JSON, does not fit the schema or is of
    /// another version is an error that names it.
    pub(crate) fn read(path: &Path) -> anyhow::Result<Self> {
        #[derive(Deserialize)]
        struct Version {
            schema: u32,
        }
        let text = std::fs::read_to_string(path)
            .with_context(|| format!("cannot read {}", path.display()))?;
        let version: Version = serde_json::from_str(&text)
            .with_context(|| format!("{} is not a results file", path.display()))?;
        if version.schema != SCHEMA {
            bail!(
                "{} has schema {}, this build reads schema {SCHEMA}: run the bench again",
                path.display(),
                version.schema
            );
        }
        serde_json::from_str(&text)
            .with_context(|| format!("{} does not fit schema {SCHEMA}", path.display()))
    }

    /// Writes `results.json` and `results.csv` into `dir`, which must exist.
    pub(crate) fn write(&self, dir: &Path) -> anyhow::Result<()> {
        let json = dir.join("results.json");
        let text = serde_json::to_string_pretty(self).context("cannot serialise the results")?;
        std::fs::write(&json, text + "\n")
            .with_context(|| format!("cannot write {}", json.display()))?;
        let csv = dir.join("results.csv");
        self.write_csv(&csv).with_context(|| format!("cannot write {}", csv.display()))
    }

    /// One row per run: what it was, every metric of [`columns::METRICS`], and the work counters of
    /// all runs as `work.NAME`.
    fn write_csv(&self, path: &Path) -> anyhow::Result<()> {
        let counters: BTreeSet<&String> = self.runs.iter().flat_map(|r| r.work.keys()).collect();
        let mut writer = csv::Writer::from_path(path)?;

        let labels = ["scene", "light", "technique", "status"].map(str::to_owned);
        let metrics = columns::METRICS.iter().map(|c| c.id.to_owned());
        let work = counters.iter().map(|name| format!("work.{name}"));
        let details = [
            "reference",
            "reference_light_samples",
            "reference_error_estimate",
            "light_json",
            "config_json",
        ];
        let header = labels.into_iter().chain(metrics).chain(work);
        writer.write_record(header.chain(details.map(str::to_owned)))?;

        for run in &self.runs {
            let labels = [
                run.scene.clone(),
                run.light.kind().name().to_owned(),
                run.technique.clone(),
                run.status.to_string(),
            ];
            let metrics = columns::METRICS.iter().map(|c| cell(c.value(run)));
            let work = counters.iter().map(|name| cell(run.work.get(*name)));
            let details = [
                cell(run.reference.as_ref().map(|r| &r.kind)),
                cell(run.reference.as_ref().map(|r| r.light_samples)),
                cell(run.reference.as_ref().and_then(|r| r.error_estimate)),
                serde_json::to_string(&run.light)?,
                run.config.to_string(),
            ];
            writer.write_record(labels.into_iter().chain(metrics).chain(work).chain(details))?;
        }
        Ok(writer.flush()?)
    }
}

fn cell(value: Option<impl ToString>) -> String {
    value.map_or_else(String::new, |v| v.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_is_of_finite_samples_only() {
        let spread = Spread::of(&[3.0, 1.0, 2.0]).expect("three numbers");
        assert_eq!(spread, Spread { median: 2.0, min: 1.0, max: 3.0 }, "odd number of samples");
        assert_eq!(Spread::of(&[1.0, 2.0]).map(|s| s.median), Some(1.5), "even number of samples");
        assert_eq!(Spread::of(&[]), None, "nothing measured");
        assert_eq!(Spread::of(&[1.0, f64::NAN]), None, "not a time");
    }

    #[test]
    fn status_is_one_string_in_files() {
        for status in
            [Status::Ok, Status::Failed("a: b".to_owned()), Status::Skipped("why".to_owned())]
        {
            let json = serde_json::to_string(&status).expect("serialises");
            assert_eq!(json, format!("\"{status}\""), "as printed");
            let back: Status = serde_json::from_str(&json).expect("deserialises");
            assert_eq!(back, status, "there and back");
        }
        assert!(serde_json::from_str::<Status>("\"fine\"").is_err(), "no other word");
    }

    #[test]
    fn fields_have_the_names_of_the_schema() {
        let json = serde_json::to_value(crate::sample::results()).expect("serialises");
        let fields = |value: &serde_json::Value| -> Vec<String> {
            value.as_object().expect("an object").keys().cloned().collect()
        };
        let run = &json["runs"][0];
        let expected = [
            "bytes",
            "config",
            "error",
            "files",
            "light",
            "reference",
            "scene",
            "status",
            "technique",
            "time",
            "work",
        ];
        assert_eq!(fields(run), expected, "a run");
        assert_eq!(fields(&run["time"]), ["cpu_ms", "gpu_ms", "ratio_to_plain"], "its time");
        assert_eq!(fields(&run["time"]["gpu_ms"]), ["max", "median", "min"], "its GPU time");
        assert_eq!(
            fields(&run["reference"]),
            ["error_estimate", "kind", "light_samples"],
            "its reference"
        );
        assert_eq!(json["schema"], 1, "the version");
        assert_eq!(run["light"]["kind"], "spot", "the kind of its light");
        assert_eq!(json["stability"][0]["expected"], "holds", "what theory says");
        assert!(json["runs"][8]["error"].is_null(), "not measured is null");
    }
}
