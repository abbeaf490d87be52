//! Any set of samples of a light, and the tables that make masks of it.

use antumbra_gpu::GpuError;
use serde::{Deserialize, Serialize};

use crate::Samples;

/// Where the samples of a mask lie.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pattern {
    /// Tiles of a rotated grid of four, whose masks follow by shifts alone (default). 33 levels for an edge along the light's
    /// side with 256 samples, 257 for others.
    #[default]
    Tiles,
    /// One at random in each cell of a square grid.
    Jittered,
    /// Hammersley's points (i + 1/2) / n and the radical inverse of i: 257 levels along both sides with 256 samples.
    Hammersley,
    /// None nearer to another than 3/4 of the side of a cell of n, or a little less: at random.
    Poisson,
    /// These, at most 1024, in [0, 1)², in place of as many as `samples` says.
    Points(Vec<[f32; 2]>),
}

/// Most samples of a pattern.
const MOST: usize = 1024;

/// Most buckets a side, a power of two.
const MOST_BUCKETS: u32 = 1 << 14;

/// Coordinates that a bucket may hold: a vector of them.
const HELD: usize = 4;

impl Pattern {
    /// The samples, none for tiles, whose masks need no table.
    ///
    /// # Errors
    /// No points, too many, or one outside of the light.
    pub fn points(&self, samples: Samples) -> Result<Option<Vec<[f32; 2]>>, GpuError> {
        let side = samples.cells();
        let points = match self {
            Self::Tiles => return Ok(None),
            Self::Jittered => jittered(side),
            Self::Hammersley => hammersley(side * side),
            Self::Poisson => poisson(side * side),
            Self::Points(points) => points.clone(),
        };
        let invalid = |value, fix| Err(GpuError::Invalid { what: "pattern", value, fix });
        if points.is_empty() || points.len() > MOST {
            return invalid(format!("{} points", points.len()), "use 1 to 1024 points");
        }
        let is_off = |point: &&[f32; 2]| !point.iter().all(|t| (0.0..1.0).contains(t));
        if let Some(point) = points.iter().find(is_off) {
            return invalid(
                format!("a point at {point:?}"),
                "use coordinates of at least 0 and below 1",
            );
        }
        Ok(Some(points))
    }

    /// The tables of the samples, none for tiles.
    ///
    /// # Errors
    /// As [`Pattern::points`], and more than four points whose coordinates differ by too little to be told apart.
    pub fn tables(&self, samples: Samples) -> Result<Option<PatternTables>, GpuError> {
        self.points(samples)?.map(|points| PatternTables::new(&points)).transpose()
    }
}

/// SplitMix64 (Steele, Lea, Flood 2014), as numbers in [0, 1).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 * 0.5f64.powi(53)
    }
}

/// The nearest number below 1 where rounding came to 1.
fn within(t: f64) -> f32 {
    (t as f32).min(1.0 - 0.5 * f32::EPSILON)
}

fn jittered(side: u32) -> Vec<[f32; 2]> {
    let mut random = Random(1);
    let mut place = |cell: u32| within((f64::from(cell) + random.next()) / f64::from(side));
    (0..side * side).map(|i| [place(i % side), place(i / side)]).collect()
}

fn hammersley(count: u32) -> Vec<[f32; 2]> {
    let inverse = |i: u32| f64::from(i.reverse_bits()) / 4_294_967_296.0;
    let along = |i: u32| (f64::from(i) + 0.5) / f64::from(count);
    (0..count).map(|i| [within(along(i)), within(inverse(i))]).collect()
}

/// By throwing darts (Cook 1986), a twentieth nearer whenever 64 for each sample did not find enough places.
fn poisson(count: u32) -> Vec<[f32; 2]> {
    let mut random = Random(2);
    let mut points: Vec<[f64; 2]> = Vec::new();
    let mut apart = 0.75 / f64::from(count).sqrt();
    while points.len() < count as usize {
        for _ in 0..64 * count {
            let dart = [random.next(), random.next()];
            let square = |p: &[f64; 2]| (p[0] - dart[0]).powi(2) + (p[1] - dart[1]).powi(2);
            if points.len() < count as usize && points.iter().all(|p| square(p) >= apart * apart) {
                points.push(dart);
            }
        }
        apart *= 0.95;
    }
    points.into_iter().map(|p| p.map(within)).collect()
}

/// `pattern` of `soft/pattern_mask.wesl`: for either coordinate the masks of the samples below each one that there is, so that
/// of a rectangle four of them tell the samples, exactly (Schwarz, Stamminger 2009 have such masks at the steps of a table).
#[derive(Clone, Debug, PartialEq)]
pub struct PatternTables {
    /// Constants of the shader.
    pub constants: String,
    /// The samples; the buckets of x, of y; the masks of x, of y.
    pub data: Vec<[u32; 4]>,
}

impl PatternTables {
    fn new(points: &[[f32; 2]]) -> Result<Self, GpuError> {
        let sorted = [0, 1].map(|axis| {
            let mut all: Vec<f32> = points.iter().map(|point| point[axis]).collect();
            all.sort_by(f32::total_cmp);
            all.dedup();
            all
        });
        let fit = |buckets: &u32| sorted.iter().all(|all| crowd(all, *buckets) <= HELD);
        let sizes = (2..=MOST_BUCKETS.trailing_zeros()).map(|k| 1 << k);
        let Some(buckets) = sizes.into_iter().find(fit) else {
            let value = "more than four coordinates within 1/16384".to_owned();
            let fix = "move points apart, or give them the same coordinate";
            return Err(GpuError::Invalid { what: "pattern", value, fix });
        };
        // 1, 2, 4 or 8 vectors.
        let words = points.len().div_ceil(128).next_power_of_two();
        let mut data: Vec<[u32; 4]> =
            points.iter().map(|[x, y]| [x.to_bits(), y.to_bits(), 0, 0]).collect();
        for all in &sorted {
            for bucket in 0..buckets {
                let first = all.partition_point(|t| bucket_of(*t, buckets) < bucket);
                // Beyond the last none is below anything.
                let held = |k| all.get(first + k).copied().unwrap_or(2.0_f32).to_bits();
                data.push([first as u32, 0, 0, 0]);
                data.push([held(0), held(1), held(2), held(3)]);
            }
        }
        let mut begins = [0; 2];
        for (axis, all) in sorted.iter().enumerate() {
            begins[axis] = data.len();
            for below in all.iter().copied().chain([2.0]) {
                let mask = mask_of(points, |point| point[axis] < below);
                data.extend(mask.chunks(4).map(|w| [w[0], w[1], w[2], w[3]]));
            }
        }
        let constants = format!(
            "const POINTS: i32 = {};\nconst POINT_WORDS: i32 = {words};\nconst BUCKETS: i32 = {buckets};\n\
             const X_MASKS: i32 = {};\nconst Y_MASKS: i32 = {};\n",
            points.len(),
            begins[0],
            begins[1],
        );
        Ok(Self { constants, data })
    }
}

/// The mask of the samples that `holds` is true of, in the shader's words.
fn mask_of(points: &[[f32; 2]], holds: impl Fn(&[f32; 2]) -> bool) -> Vec<u32> {
    let mut mask = vec![0; 4 * points.len().div_ceil(128).next_power_of_two()];
    for (i, _) in points.iter().enumerate().filter(|(_, point)| holds(point)) {
        mask[i / 32] |= 1 << (i % 32);
    }
    mask
}

fn bucket_of(t: f32, buckets: u32) -> u32 {
    (t * buckets as f32) as u32
}

/// Most coordinates in a bucket.
fn crowd(sorted: &[f32], buckets: u32) -> usize {
    let same = |a: &f32, b: &f32| bucket_of(*a, buckets) == bucket_of(*b, buckets);
    sorted.chunk_by(same).map(<[f32]>::len).max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> impl Iterator<Item = (Pattern, Samples, Vec<[f32; 2]>)> {
        let kinds = [Pattern::Jittered, Pattern::Hammersley, Pattern::Poisson];
        kinds.into_iter().flat_map(|pattern| {
            [Samples::S64, Samples::S256, Samples::S1024].map(|samples| {
                let points = pattern.points(samples).ok().flatten().expect("a valid pattern");
                (pattern.clone(), samples, points)
            })
        })
    }

    #[test]
    fn patterns_have_as_many_samples_as_they_should_and_lie_as_they_are_said_to() {
        for (pattern, samples, points) in all() {
            let (side, count) = (samples.cells(), samples.cells().pow(2));
            assert_eq!(points.len(), count as usize, "{pattern:?}, {samples:?}");
            let mut cells: Vec<(u32, u32)> =
                points.iter().map(|p| (bucket_of(p[0], side), bucket_of(p[1], side))).collect();
            cells.sort_unstable();
            cells.dedup();
            let is_stratified = cells.len() == count as usize;
            assert_eq!(is_stratified, pattern != Pattern::Poisson, "{pattern:?}, {samples:?}");
            let square = |a: &[f32; 2], b: &[f32; 2]| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
            let pairs = points.iter().enumerate();
            let nearest = pairs
                .flat_map(|(i, a)| points[..i].iter().map(move |b| square(a, b)))
                .fold(f32::MAX, f32::min);
            let apart = nearest.sqrt() * f32::from(side as u16);
            // Darts come to less than three quarters of a cell where there was no room.
            match pattern {
                Pattern::Poisson => assert!(apart >= 0.6, "{samples:?}: {apart} cells apart"),
                Pattern::Jittered => assert!(apart < 0.6, "{samples:?}: {apart}, the control"),
                _ => {}
            }
        }
    }

    #[test]
    fn edges_along_the_sides_have_many_levels_and_tiles_few() {
        let worst = |points: &[[f32; 2]], axis: usize| {
            let mut levels = std::collections::BTreeSet::new();
            let mut worst: f64 = 0.0;
            for i in 0..=10_000 {
                let x = i as f32 / 10_000.0;
                let count = points.iter().filter(|point| point[axis] < x).count();
                levels.insert(count);
                worst = worst.max((count as f64 / points.len() as f64 - f64::from(x)).abs());
            }
            (levels.len(), worst)
        };
        for (pattern, samples, points) in all().filter(|(_, samples, _)| *samples == Samples::S256)
        {
            for axis in [0, 1] {
                let (levels, worst) = worst(&points, axis);
                assert!(levels > 128, "{pattern:?}, {samples:?}: {levels} levels");
                // A jittered column may lie on one side of the edge as a whole; Hammersley's points are one a step.
                let most = if pattern == Pattern::Hammersley { 1.1 / 256.0 } else { 1.0 / 16.0 };
                assert!(worst < most, "{pattern:?}: off by {worst}");
            }
        }
    }

    #[test]
    fn points_that_make_no_pattern_are_refused_with_a_fix() {
        let refuses = |points: Vec<[f32; 2]>, fix: &str| {
            let found = Pattern::Points(points).points(Samples::S64);
            let error = found.err().map(|error| error.to_string()).unwrap_or_default();
            assert!(error.contains(fix), "`{error}` says nothing of `{fix}`");
        };
        refuses(Vec::new(), "1 to 1024");
        refuses(vec![[0.5; 2]; 1025], "1 to 1024");
        for wrong in [1.0, -0.1, f32::NAN] {
            refuses(vec![[0.5, wrong]], "below 1");
        }
        let near: Vec<[f32; 2]> = (0..5).map(|i| [0.5 + i as f32 * 1e-6, 0.5]).collect();
        assert!(PatternTables::new(&near).is_err(), "five within a millionth");
        assert!(
            PatternTables::new(&near[..4]).is_ok() && PatternTables::new(&[[0.5; 2]; 9]).is_ok(),
            "controls"
        );
    }
}
