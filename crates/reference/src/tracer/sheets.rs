//! Triangles that let a part of the light through.

use std::ops::Range;
use std::sync::Arc;

use antumbra_scene::{Opacity, TranslucentInstance, Triangles};
use glam::{DVec2, Vec2};

use super::TraceError;
use super::build::{self, Tree};
use super::cut::Whole;
use super::traverse::Visitor;

/// The translucent triangles of a scene, in a tree of their own: a ray goes through all that it meets.
#[derive(Clone)]
pub(super) struct Sheets {
    pub(super) tree: Tree,
    /// In the order of the tree's triangles.
    runs: Vec<Run>,
}

/// Triangles that follow one another and share an opacity.
#[derive(Clone)]
struct Run {
    triangles: Range<u32>,
    /// Texture coordinates of the corners of each.
    uv: Vec<[Vec2; 3]>,
    opacity: Arc<Opacity>,
}

impl Sheets {
    /// The translucent triangles of `list`, whose indices are in range; `None` where all are opaque.
    pub(super) fn new(list: &Triangles) -> Result<Option<Self>, TraceError> {
        let mut sheets = Triangles {
            origin: list.origin,
            positions: list.positions.clone(),
            ..Triangles::default()
        };
        let mut runs = Vec::new();
        for TranslucentInstance { instance, first_vertex, opacity } in &list.translucent {
            let range = list.instances.get(*instance).filter(|_| opacity.alpha.is_valid());
            let range = range.filter(|range| range.end <= list.triangles.len());
            let range = range.ok_or(TraceError::Opacity { triangle: 0 })?.clone();
            let mut uv = Vec::with_capacity(range.len());
            for triangle in range.clone() {
                let corner = |index: u32| {
                    let vertex = index.checked_sub(*first_vertex)?;
                    opacity.uv.get(vertex as usize).copied()
                };
                let [Some(a), Some(b), Some(c)] = list.triangles[triangle].map(corner) else {
                    return Err(TraceError::Opacity { triangle });
                };
                uv.push([a, b, c]);
            }
            let first = sheets.triangles.len() as u32;
            sheets.triangles.extend_from_slice(&list.triangles[range]);
            let triangles = first..sheets.triangles.len() as u32;
            runs.push(Run { triangles, uv, opacity: opacity.clone() });
        }
        runs.retain(|run| !run.uv.is_empty());
        Ok((!runs.is_empty()).then(|| Self { tree: build::build(&sheets), runs }))
    }

    /// The share of the light that gets through a triangle at the mean of its corners with these weights.
    fn lets_through(&self, triangle: u32, weights: [f64; 3]) -> f64 {
        let run = self.runs.partition_point(|run| run.triangles.start <= triangle) - 1;
        let Run { triangles, uv, opacity } = &self.runs[run];
        let corners = uv[(triangle - triangles.start) as usize];
        let sum: DVec2 = corners.iter().zip(weights).map(|(uv, w)| uv.as_dvec2() * w).sum();
        1.0 - f64::from(opacity.at((sum / weights.iter().sum::<f64>()).as_vec2()))
    }
}

/// Goes through all that is met.
pub(super) struct Through<'a> {
    sheets: &'a Sheets,
    end: f32,
    /// What was met. A tree may hold a triangle more than once: packets are filled up with their last.
    met: Vec<u32>,
    /// The share of the light that gets through all that was met.
    pub(super) share: f64,
}

impl<'a> Through<'a> {
    pub(super) fn new(sheets: &'a Sheets) -> Self {
        Self { sheets, end: f32::MAX, met: Vec::new(), share: 1.0 }
    }
}

impl Visitor for Through<'_> {
    type Surface = Whole;
    const DEPTHS: bool = true;

    fn surface(&self) -> Whole {
        Whole
    }

    fn begin(&mut self, end: f32) {
        self.end = end;
    }

    fn meet(&mut self, triangle: u32, _: f64, weights: [f64; 3]) -> f32 {
        if !self.met.contains(&triangle) {
            self.met.push(triangle);
            self.share *= self.sheets.lets_through(triangle, weights);
        }
        if self.share > 0.0 { self.end } else { 0.0 }
    }
}
