//! Triangles of which only a part is there.
//!
//! Where there are none, the traversal is compiled without any trace of them: scenes of whole triangles pay nothing.

use std::ops::Range;
use std::sync::Arc;

use antumbra_scene::{Cutout, Triangles};
use glam::{DVec2, Vec2};

use super::TraceError;

/// What the traversal asks of triangles that a ray meets.
pub(super) trait Surface: Copy {
    /// Whether some triangles have holes.
    const CUT: bool;
    /// Whether this triangle has holes.
    fn is_cut(self, triangle: u32) -> bool;
    /// Whether a triangle with holes is there, at the mean of its corners with these weights, whose sum is not 0.
    fn is_there(self, triangle: u32, weights: [f64; 3]) -> bool;
}

/// All triangles are whole.
#[derive(Clone, Copy)]
pub(super) struct Whole;

impl Surface for Whole {
    const CUT: bool = false;
    #[inline(always)]
    fn is_cut(self, _: u32) -> bool {
        false
    }
    #[inline(always)]
    fn is_there(self, _: u32, _: [f64; 3]) -> bool {
        true
    }
}

/// The triangles with holes.
#[derive(Clone)]
pub(super) struct Cuts {
    /// A bit a triangle of the list.
    flags: Vec<u64>,
    /// In the order of the list.
    runs: Vec<Run>,
}

/// Triangles that follow one another and share a cut-out.
#[derive(Clone)]
struct Run {
    triangles: Range<u32>,
    /// Texture coordinates of the corners of each.
    uv: Vec<[Vec2; 3]>,
    cutout: Arc<Cutout>,
}

impl Cuts {
    /// The cut-outs of `list`, whose indices are in range; `None` where all triangles are whole.
    pub(super) fn new(list: &Triangles) -> Result<Option<Self>, TraceError> {
        let mut flags = vec![0; list.triangles.len().div_ceil(64)];
        let mut runs = Vec::new();
        for cut in &list.cuts {
            let range = list.instances.get(cut.instance).filter(|_| cut.cutout.alpha.is_valid());
            let range = range.filter(|range| range.end <= list.triangles.len());
            let range = range.ok_or(TraceError::Cutout { triangle: 0 })?.clone();
            let mut uv = Vec::with_capacity(range.len());
            for triangle in range.clone() {
                let corner = |index: u32| {
                    let vertex = index.checked_sub(cut.first_vertex)?;
                    cut.cutout.uv.get(vertex as usize).copied()
                };
                let [a, b, c] = list.triangles[triangle].map(corner);
                let (Some(a), Some(b), Some(c)) = (a, b, c) else {
                    return Err(TraceError::Cutout { triangle });
                };
                uv.push([a, b, c]);
                flags[triangle / 64] |= 1 << (triangle % 64);
            }
            let triangles = range.start as u32..range.end as u32;
            runs.push(Run { triangles, uv, cutout: cut.cutout.clone() });
        }
        runs.retain(|run| !run.uv.is_empty());
        runs.sort_by_key(|run| run.triangles.start);
        Ok((!runs.is_empty()).then_some(Self { flags, runs }))
    }
}

impl Surface for &Cuts {
    const CUT: bool = true;

    #[inline(always)]
    fn is_cut(self, triangle: u32) -> bool {
        self.flags[triangle as usize / 64] >> (triangle % 64) & 1 == 1
    }

    fn is_there(self, triangle: u32, weights: [f64; 3]) -> bool {
        if !self.is_cut(triangle) {
            return true;
        }
        let run = self.runs.partition_point(|run| run.triangles.start <= triangle) - 1;
        let Run { triangles, uv, cutout } = &self.runs[run];
        let corners = uv[(triangle - triangles.start) as usize];
        let sum: DVec2 = corners.iter().zip(weights).map(|(uv, w)| uv.as_dvec2() * w).sum();
        cutout.is_there((sum / weights.iter().sum::<f64>()).as_vec2())
    }
}
