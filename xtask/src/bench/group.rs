//! One scene under one light: the truth, and every technique beside it.

use std::path::Path;

use antumbra_gpu::{Gpu, Technique};
use antumbra_measure::{MeasureError, Shot, Stage};
use antumbra_reference::{Comparison, Truth, TruthOptions};
use antumbra_scene::{Light, LightKind};
use anyhow::Context as _;
use indicatif::ProgressBar;

use super::images;
use super::plan::{Entry, Plan, Subject};
use crate::results::{Files, Reference, Run, Spread, Status, Time};

/// The technique that time ratios refer to.
const PLAIN: &str = "map/plain";

/// Measures every light and technique of the plan on one scene; raw images go to `out`.
pub(super) fn measure_scene(
    gpu: &Gpu,
    plan: &Plan,
    subject: &Subject,
    out: &Path,
    progress: &ProgressBar,
) -> anyhow::Result<Vec<Run>> {
    let [width, height] = plan.settings.size;
    let camera = subject.scene.camera_or_framing();
    let stage = Stage::new(gpu, &subject.scene, camera, width, height)
        .with_context(|| subject.name.clone())?;
    let folder = out.join(&subject.slug);
    std::fs::create_dir_all(&folder)
        .with_context(|| format!("cannot make the directory {}", folder.display()))?;
    let mut shared = Files { mesh: None, ..Files::default() };
    if plan.dump_mesh {
        let name = format!("{}/mesh.obj", subject.slug);
        let path = out.join(&name);
        let file = std::fs::File::create(&path)
            .with_context(|| format!("cannot write {}", path.display()))?;
        stage.triangles.write_obj(std::io::BufWriter::new(file))?;
        shared.mesh = Some(name);
    }
    shared.normal = Some(images::write_normals(&stage, out, &subject.slug)?);

    let mut runs = Vec::new();
    for kind in &plan.lights {
        progress.set_message(format!("{} · {}", subject.name, kind.name()));
        let group = Group { gpu, plan, subject, stage: &stage, out, kind: *kind };
        runs.extend(group.measure(&shared, progress)?);
    }
    Ok(runs)
}

struct Group<'a> {
    gpu: &'a Gpu,
    plan: &'a Plan,
    subject: &'a Subject,
    stage: &'a Stage,
    out: &'a Path,
    kind: LightKind,
}

/// A technique on its way through a group.
struct Candidate<'a> {
    entry: &'a Entry,
    technique: Result<Box<dyn Technique>, MeasureError>,
    shot: Shot,
}

impl Group<'_> {
    fn measure(&self, shared: &Files, progress: &ProgressBar) -> anyhow::Result<Vec<Run>> {
        let light = self.subject.scene.light_or_placed(self.kind);
        let options = TruthOptions {
            light_samples: self.plan.settings.light_samples,
            ties: true,
            ..TruthOptions::default()
        };
        let truth = self.stage.truth(&light, &options);
        let prefix = format!("{}/{}", self.subject.slug, self.kind.name());
        let mut files = shared.clone();
        files.reference = Some(images::write_scalar(
            self.stage,
            self.out,
            &prefix,
            "reference",
            &truth.visibility,
        )?);
        files.position =
            Some(images::write_positions(self.stage, self.out, &prefix, &truth.class)?);

        let mut candidates: Vec<Candidate<'_>> = self
            .plan
            .techniques
            .iter()
            .map(|entry| Candidate {
                entry,
                technique: entry.config.build(self.gpu).map_err(MeasureError::from),
                shot: Shot::default(),
            })
            .collect();
        let plain_ms = self.time(&light, &mut candidates)?;
        let mut runs = Vec::new();
        for candidate in candidates {
            let run = self.conclude(candidate, &light, &truth, &files, &prefix, plain_ms)?;
            runs.push(run);
            progress.inc(1);
        }
        Ok(runs)
    }

    /// Runs all techniques in turn, again and again, so that whatever else the machine does hits all alike.
    /// Returns the median time of the plain map.
    fn time(&self, light: &Light, candidates: &mut [Candidate<'_>]) -> anyhow::Result<Option<f64>> {
        let mut session = self.stage.session(self.gpu)?;
        let has_plain = candidates.iter().any(|c| c.entry.name == PLAIN);
        let mut config = antumbra::Config::Plain(Default::default());
        config.set_map_size(self.plan.settings.map_size);
        let mut yardstick = (!has_plain).then(|| config.build(self.gpu)).transpose()?;
        let mut plain = Shot::default();
        for round in 0..=self.plan.settings.repeat {
            // The first round warms up: pipelines compile on first use.
            let keep = round > 0;
            if let Some(technique) = &mut yardstick {
                session.repeat(self.gpu, light, technique.as_mut(), &mut plain, keep)?;
            }
            for Candidate { technique, shot, .. } in candidates.iter_mut() {
                let Ok(ready) = technique else { continue };
                let done = session.repeat(self.gpu, light, ready.as_mut(), shot, keep);
                // Of a still frame: what is kept from frame to frame was kept.
                let last = round == self.plan.settings.repeat;
                let done = done.and_then(|()| match last {
                    true => session.conclude(self.gpu, ready.as_ref(), shot),
                    false => Ok(()),
                });
                if let Err(error) = done {
                    *technique = Err(error);
                }
            }
        }
        let plain = candidates.iter().find(|c| c.entry.name == PLAIN).map_or(&plain, |c| &c.shot);
        Ok(Spread::of(&plain.gpu_ms).map(|s| s.median))
    }

    fn conclude(
        &self,
        candidate: Candidate<'_>,
        light: &Light,
        truth: &Truth,
        files: &Files,
        prefix: &str,
        plain_ms: Option<f64>,
    ) -> anyhow::Result<Run> {
        let Candidate { entry, technique, shot } = candidate;
        let mut run = Run {
            scene: self.subject.name.clone(),
            light: *light,
            technique: entry.name.clone(),
            config: serde_json::to_value(&entry.config)?,
            status: Status::Ok,
            error: None,
            time: None,
            work: Default::default(),
            bytes: None,
            reference: Some(Reference {
                kind: "ray-traced".to_owned(),
                light_samples: truth.light_samples,
                error_estimate: Some(truth.error_estimate),
            }),
            files: files.clone(),
        };
        if let Err(error) = technique {
            run.status = Status::Failed(error.to_string());
            return Ok(run);
        }
        let name = format!("{prefix}-{}", entry.name.replace('/', "-"));
        run.files.visibility = Some(images::write_scalar(
            self.stage,
            self.out,
            &name,
            "visibility",
            &shot.visibility,
        )?);
        let comparison = Comparison {
            estimate: &shot.visibility,
            reference: &truth.visibility,
            classes: &truth.class,
            width: self.stage.image.width as usize,
        };
        match comparison.metrics() {
            Ok(mut metrics) => {
                let shaded = images::shade(self.stage, light, &shot.visibility);
                let true_shaded = images::shade(self.stage, light, &truth.visibility);
                metrics.flip = Some(images::flip(&shaded, &true_shaded, self.stage)?);
                run.files.shaded =
                    Some(images::write_shaded(self.stage, self.out, &name, &shaded)?);
                run.error = Some(metrics);
            }
            Err(error) => run.status = Status::Failed(error.to_string()),
        }
        let gpu_ms = Spread::of(&shot.gpu_ms);
        run.time = Some(Time {
            gpu_ms,
            cpu_ms: Spread::of(&shot.cpu_ms).map(|s| s.median),
            ratio_to_plain: gpu_ms.zip(plain_ms).map(|(ms, plain)| ms.median / plain),
        });
        run.work = shot.counters.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
        run.bytes = Some(shot.bytes);
        Ok(run)
    }
}
