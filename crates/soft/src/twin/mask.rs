//! `soft/mask.wesl`: bits for the samples of a light.

use glam::{DVec2, DVec3};

use crate::Samples;

/// The four samples within a tile.
const OFFSETS: [DVec2; 4] = [
    DVec2::new(0.125, 0.625),
    DVec2::new(0.375, 0.125),
    DVec2::new(0.625, 0.875),
    DVec2::new(0.875, 0.375),
];

/// A mask, in the words of the shader.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    tiles: i32,
    rows: i32,
    /// The words: those of the first sample of each tile, of the second, and so on.
    pub words: Vec<u32>,
}

impl Mask {
    /// No sample.
    #[must_use]
    pub fn new(samples: Samples) -> Self {
        let tiles = samples.tiles() as i32;
        let rows = (32 / tiles).min(tiles);
        Self { tiles, rows, words: vec![0; (4 * tiles / rows) as usize] }
    }

    fn words_each(&self) -> i32 {
        self.tiles / self.rows
    }

    /// Every sample: index within its tile, column, row, and place in [0, 1]².
    pub fn samples(&self) -> impl Iterator<Item = (usize, i32, i32, DVec2)> + use<> {
        let tiles = self.tiles;
        (0..4).flat_map(move |s| {
            (0..tiles * tiles).map(move |i| {
                let (column, row) = (i % tiles, i / tiles);
                let tile = DVec2::new(f64::from(column), f64::from(row));
                (s, column, row, (tile + OFFSETS[s]) / f64::from(tiles))
            })
        })
    }

    /// `add_sample`.
    pub fn add_sample(&mut self, s: usize, column: i32, row: i32) {
        let word = s as i32 * self.words_each() + row / self.rows;
        self.words[word as usize] |= 1 << (column + self.tiles * (row % self.rows));
    }

    /// `add_rectangle`.
    pub fn add_rectangle(&mut self, lo: DVec2, hi: DVec2) {
        for (s, offset) in OFFSETS.into_iter().enumerate() {
            let (from, to) = (self.first_tile(lo, offset), self.first_tile(hi, offset));
            if to.0 > from.0 {
                self.add_rows(s, self.columns(from.0, to.0), from.1, to.1);
            }
        }
    }

    /// `add_triangle`.
    pub fn add_triangle(&mut self, corners: [DVec2; 3]) {
        let [a, b, c] = corners;
        let (bottom, top) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
        for (s, o) in OFFSETS.into_iter().enumerate() {
            let first = self.first_tile(DVec2::new(0.0, bottom), o).1;
            let last = self.first_tile(DVec2::new(0.0, top), o).1;
            for row in first..last {
                let y = (f64::from(row) + o.y) / f64::from(self.tiles);
                let sides = [(a, b), (b, c), (c, a)];
                let at = || sides.iter().filter_map(|(p, q)| crossing(*p, *q, y));
                let lo = at().fold(f64::INFINITY, f64::min);
                let hi = at().fold(f64::NEG_INFINITY, f64::max);
                let from = self.first_tile(DVec2::new(lo, 0.0), o).0;
                let to = self.first_tile(DVec2::new(hi, 0.0), o).0;
                if to > from {
                    self.add_rows(s, self.columns(from, to), row, row + 1);
                }
            }
        }
    }

    /// `add_half_planes`.
    pub fn add_half_planes(&mut self, planes: &[DVec3; 5]) {
        for (s, o) in OFFSETS.into_iter().enumerate() {
            for row in 0..self.tiles {
                let y = (f64::from(row) + o.y) / f64::from(self.tiles);
                let (mut lo, mut hi) = (0.0f64, 1.0f64);
                for g in planes {
                    let rest = g.y * y + g.z;
                    if g.x > 0.0 {
                        lo = lo.max(-rest / g.x);
                    } else if g.x < 0.0 {
                        hi = hi.min(-rest / g.x);
                    } else if rest < 0.0 {
                        hi = -1.0;
                    }
                }
                let from = self.first_tile(DVec2::new(lo, 0.0), o).0;
                let to = self.first_tile(DVec2::new(hi, 0.0), o).0;
                if to > from {
                    self.add_rows(s, self.columns(from, to), row, row + 1);
                }
            }
        }
    }

    /// Number of samples marked here and in `other`.
    #[must_use]
    pub fn count_in(&self, other: &Self) -> u32 {
        self.words.iter().zip(&other.words).map(|(a, b)| (a & b).count_ones()).sum()
    }

    /// Number of samples marked.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.words.iter().map(|word| word.count_ones()).sum()
    }

    fn first_tile(&self, at: DVec2, o: DVec2) -> (i32, i32) {
        let tiles = f64::from(self.tiles);
        let first = (tiles * at - o).ceil().clamp(DVec2::ZERO, DVec2::splat(tiles));
        (first.x as i32, first.y as i32)
    }

    fn columns(&self, from: i32, to: i32) -> u32 {
        let one = (1u32 << to) - (1u32 << from);
        (0..self.rows).fold(0, |all, row| all | one << (row * self.tiles))
    }

    fn add_rows(&mut self, s: usize, pattern: u32, from: i32, to: i32) {
        let each = self.words_each();
        for word in 0..each {
            let a = (from - word * self.rows).clamp(0, self.rows);
            let b = (to - word * self.rows).clamp(0, self.rows);
            if b > a {
                let below = |rows: i32| (1u64 << (rows * self.tiles)) as u32;
                let bits = below(b).wrapping_sub(1) & !below(a).wrapping_sub(1);
                self.words[(s as i32 * each + word) as usize] |= pattern & bits;
            }
        }
    }
}

fn crossing(p: DVec2, q: DVec2, y: f64) -> Option<f64> {
    let is_up = p.y < q.y || (p.y == q.y && p.x < q.x);
    let (low, high) = if is_up { (p, q) } else { (q, p) };
    (low.y <= y && y < high.y).then(|| low.x + (y - low.y) * ((high.x - low.x) / (high.y - low.y)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::random;

    const ALL: [Samples; 3] = [Samples::S64, Samples::S256, Samples::S1024];

    fn brute(samples: Samples, inside: impl Fn(DVec2) -> bool) -> Mask {
        let mut mask = Mask::new(samples);
        for (s, column, row, at) in mask.samples() {
            if inside(at) {
                mask.add_sample(s, column, row);
            }
        }
        mask
    }

    /// Corners anywhere, on samples, at the borders, degenerate and outside; f32, which the shader has.
    fn corner(state: &mut u64) -> f64 {
        let t = random(state);
        let value = match (random(state) * 4.0) as u32 {
            0 => (t * 64.0).floor() / 64.0,
            1 => t * 3.0 - 1.0,
            2 => (t * 128.0).round() / 128.0,
            _ => t,
        };
        f64::from(value as f32)
    }

    #[test]
    fn masks_of_a_million_rectangles_are_those_of_their_samples_one_by_one() {
        let mut state = 3;
        for i in 0..1_000_000 {
            // The brute force of 1024 samples takes its time.
            let samples = ALL[[0, 1, 1, 1, 1, 1, 1, 1, 1, 2][i % 10]];
            let [x0, y0, x1, y1] = [0; 4].map(|_| corner(&mut state));
            let mut mask = Mask::new(samples);
            mask.add_rectangle(DVec2::new(x0, y0), DVec2::new(x1, y1));
            let inside = |s: DVec2| x0 <= s.x && s.x < x1 && y0 <= s.y && s.y < y1;
            assert_eq!(mask, brute(samples, inside), "{samples:?}: {x0} {y0} {x1} {y1}");
        }
    }

    #[test]
    fn rectangles_that_meet_share_no_sample_and_leave_none_out() {
        for samples in ALL {
            let cuts = [-1.0, 0.125, 0.2, 0.59375, 0.6, 2.0];
            let mut union = Mask::new(samples);
            let mut sum = 0;
            for (x, y) in (0..25).map(|i| (i % 5, i / 5)) {
                let mut one = Mask::new(samples);
                one.add_rectangle(
                    DVec2::new(cuts[x], cuts[y]),
                    DVec2::new(cuts[x + 1], cuts[y + 1]),
                );
                sum += one.count();
                union.add_rectangle(
                    DVec2::new(cuts[x], cuts[y]),
                    DVec2::new(cuts[x + 1], cuts[y + 1]),
                );
            }
            let all = 4 * samples.tiles().pow(2);
            assert_eq!((sum, union.count()), (all, all), "{samples:?}");
        }
    }

    #[test]
    fn two_triangles_of_a_quadrilateral_mark_each_sample_in_it_once() {
        let mut state = 5;
        for trial in 0..20_000 {
            let samples = ALL[trial % 3];
            // A grid of corners moved at random: quadrilaterals that tile the light.
            let mut corners = [[DVec2::ZERO; 3]; 3];
            for (i, row) in corners.iter_mut().enumerate() {
                for (j, corner) in row.iter_mut().enumerate() {
                    let place = DVec2::new(j as f64, i as f64) * 1.5 - 1.0;
                    *corner = place + 0.4 * DVec2::new(random(&mut state), random(&mut state));
                }
            }
            let (mut union, mut sum) = (Mask::new(samples), 0);
            for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let [p, q] = [corners[i][j], corners[i][j + 1]];
                let [t, r] = [corners[i + 1][j], corners[i + 1][j + 1]];
                for triangle in [[p, q, r], [p, r, t]] {
                    let mut one = Mask::new(samples);
                    one.add_triangle(triangle);
                    sum += one.count();
                    union.add_triangle(triangle);
                }
            }
            let all = 4 * samples.tiles().pow(2);
            assert_eq!((sum, union.count()), (all, all), "{samples:?} in trial {trial}");
        }
    }

    #[test]
    fn an_axis_aligned_edge_has_33_levels_and_is_off_by_a_64th_at_most() {
        let mut levels = std::collections::BTreeSet::new();
        let mut worst = 0f64;
        for i in 0..=100_000 {
            let x = f64::from(i) / 100_000.0;
            let mut mask = Mask::new(Samples::S256);
            mask.add_rectangle(DVec2::ZERO, DVec2::new(x, 1.0));
            levels.insert(mask.count());
            worst = worst.max((f64::from(mask.count()) / 256.0 - x).abs());
        }
        assert_eq!(levels.len(), 33, "levels");
        // Half the step of 1/32; the edge is tried at steps of 1e-5.
        assert!((worst - 1.0 / 64.0).abs() <= 1e-5, "{worst}");
    }
}
