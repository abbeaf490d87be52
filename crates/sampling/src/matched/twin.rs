//! How pages are numbered and chosen, in f64: the truth of `sampling/matched.wesl` in tests.

use std::collections::{BTreeMap, BTreeSet};

use antumbra_gpu::ViewCamera;
use antumbra_map::TexelOnScreen;
use glam::{DMat4, DVec2, DVec3, DVec4};

/// A page: the face of the light that it lies on, its level, 0 for the finest, and its place among those of its level, from
/// the left and from the top.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Page {
    /// Face, 0 for lights that have one.
    pub face: u32,
    /// Level.
    pub level: u32,
    /// Column and row.
    pub tile: [u32; 2],
}

impl Page {
    /// The page that `sampling/matched.wesl` packs into a number, or none of a pixel that needs no page.
    #[must_use]
    pub fn from_id(id: u32) -> Option<Self> {
        let face = id >> 28;
        let tile = [id & 0xfff, (id >> 12) & 0xfff];
        (face < 6).then_some(Self { face, level: (id >> 24) & 15, tile })
    }
}

/// Ranks that there are.
const RANKS: u32 = 256;

/// The rank of a page that so many samples look at, 1 or more: eight ranks to each doubling.
#[must_use]
pub fn rank_of(samples: u32) -> u32 {
    let exponent = samples.ilog2();
    let bits = (u64::from(samples) << 3) >> exponent;
    8 * exponent + (bits % 8) as u32
}

/// A virtual map and the atlas for its pages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Virtual {
    /// Side of a page, texels, a power of two.
    pub page: u32,
    /// Width of a page's border, texels: another page's texels, for kernels to read.
    pub border: u32,
    /// Pages a side of the finest level, a power of two.
    pub table: u32,
    /// Pages a side of the atlas.
    pub row: u32,
    /// Pixels by which an edge may be displaced.
    pub rule: f32,
}

impl Virtual {
    /// Levels, the last of which is one page.
    #[must_use]
    pub fn levels(&self) -> u32 {
        self.table.ilog2() + 1
    }

    /// Side of a page without its border, texels: what it shows of its level.
    #[must_use]
    pub fn side(&self) -> u32 {
        self.page - 2 * self.border
    }

    /// Pages of all levels of a face.
    #[must_use]
    pub fn page_count(&self) -> u32 {
        (4 * self.table * self.table - 1) / 3
    }

    /// Pages that the atlas holds.
    #[must_use]
    pub fn slots(&self) -> u32 {
        self.row * self.row
    }

    /// Place of a page among all, face by face and finest level first.
    #[must_use]
    pub fn index_of(&self, page: Page) -> u32 {
        let m = self.table >> page.level;
        page.face * self.page_count()
            + 4 * (self.table * self.table - m * m) / 3
            + page.tile[1] * m
            + page.tile[0]
    }

    /// The page at a place among all.
    #[must_use]
    pub fn page_at(&self, index: u32) -> Page {
        let face = index / self.page_count();
        let (mut rest, mut level, mut m) = (index % self.page_count(), 0, self.table);
        while rest >= m * m && m > 1 {
            rest -= m * m;
            m /= 2;
            level += 1;
        }
        Page { face, level, tile: [rest % m, rest / m] }
    }

    /// The page that holds `page` at a level, its own or above.
    #[must_use]
    pub fn holder(&self, page: Page, level: u32) -> Page {
        Page { level, tile: page.tile.map(|t| t >> (level - page.level)), ..page }
    }

    /// Texels a side of the finest level.
    #[must_use]
    pub fn texels(&self) -> u32 {
        self.side() * self.table
    }

    /// The level for a sample at which the finest displaces edges by `displacement` pixels: the coarsest that does so by
    /// no more than [`Virtual::rule`], as a texel's sides double from one level to the next.
    #[must_use]
    pub fn level(&self, displacement: f64) -> u32 {
        let last = f64::from(self.levels() - 1);
        let level = (f64::from(self.rule) / displacement.clamp(1e-18, 1e18)).log2();
        level.floor().clamp(0.0, last) as u32
    }

    /// The page of a level for a point of a face's window, which goes from (0, 0) to (1, 1).
    #[must_use]
    pub fn page_of(&self, face: u32, st: DVec2, level: u32) -> Page {
        let m = self.table >> level;
        let tile = |x: f64| ((x * f64::from(m)) as u32).min(m - 1);
        Page { face, level, tile: [tile(st.x), tile(st.y)] }
    }

    /// How far from where it belongs a texel of the finest level may put a shadow's edge on the surface with unit normal
    /// `n` at `p`, pixels: half the sum of its sides. Next to infinite where the light meets the surface edge-on.
    #[must_use]
    pub fn displacement(
        &self,
        window: &DMat4,
        camera: &ViewCamera,
        pixels: [u32; 2],
        (p, n): (DVec3, DVec3),
    ) -> f64 {
        let size = DVec2::from(pixels.map(f64::from));
        let texel = TexelOnScreen::new(&camera.clip, size, window, f64::from(self.texels()), p, n);
        let sides = 0.5 * texel.sides().element_sum();
        if sides.is_finite() { sides } else { f64::MAX }
    }

    /// The pages in use for requests, of which the number of samples is known: each, or the first above it that is kept. Those
    /// are kept whose level is no finer than one at which all would fit into the atlas, or within which lie so many samples
    /// that their rank is the least or more. The least is the first that will do, and is given, too.
    #[must_use]
    pub fn fitting(&self, requests: &BTreeMap<Page, u32>) -> (u32, BTreeSet<Page>) {
        let last = self.levels() - 1;
        let mut within = BTreeMap::<Page, u32>::new();
        for (page, samples) in requests {
            for level in page.level..=last {
                *within.entry(self.holder(*page, level)).or_default() += samples;
            }
        }
        let from = |finest, least| -> BTreeSet<Page> {
            let kept = |page: &Page| {
                let is_kept =
                    |holder: &Page| holder.level >= finest || rank_of(within[holder]) >= least;
                (page.level..=last).map(|level| self.holder(*page, level)).find(is_kept)
            };
            requests.keys().filter_map(kept).collect()
        };
        let fits = |pages: &BTreeSet<Page>| pages.len() as u32 <= self.slots();
        // At the coarsest level one page of each face is left.
        let finest = (0..last).find(|finest| fits(&from(*finest, RANKS))).unwrap_or(last);
        let least = (0..RANKS).find(|least| fits(&from(finest, *least))).unwrap_or(RANKS - 1);
        (least, from(finest, least))
    }

    /// What puts a page's part of clip space into the middle half of it: its viewport is twice as wide as the page, so that
    /// the border lies in it, too, and the factor is a power of two, which rounds nothing.
    #[must_use]
    pub fn crop(&self, page: Page) -> DMat4 {
        let m = 0.5 * f64::from(self.table >> page.level);
        let [x, y] = page.tile.map(|t| m - 0.5 - f64::from(t));
        DMat4::from_cols(DVec4::X * m, DVec4::Y * m, DVec4::Z, DVec4::new(x, -y, 0.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use antumbra_scene::Camera;

    use super::*;

    const MAP: Virtual = Virtual { page: 128, border: 0, table: 32, row: 4, rule: 0.5 };

    #[test]
    fn every_page_has_a_number_of_its_own() {
        // (4^6 - 1) / 3 pages of 6 levels.
        assert_eq!((MAP.page_count(), MAP.levels()), (1365, 6), "of a table of 32 x 32");
        let mut last = Page { face: 0, level: 0, tile: [0, 0] };
        for index in 0..MAP.page_count() {
            let page = MAP.page_at(index);
            assert_eq!(MAP.index_of(page), index, "{page:?}");
            assert!(page.level >= last.level, "finest first");
            assert!(page.tile.iter().all(|&t| t < 32 >> page.level), "{page:?}");
            last = page;
        }
        assert_eq!(last, Page { face: 0, level: 5, tile: [0, 0] }, "the last is the whole window");
        let next = MAP.page_at(MAP.page_count());
        assert_eq!(next, Page { face: 1, level: 0, tile: [0, 0] }, "the first of the next face");
    }

    #[test]
    fn the_chosen_level_displaces_edges_by_no_more_than_it_may_and_by_more_than_half_of_that() {
        for i in -40..100 {
            // Of the finest level.
            let displacement = 2f64.powf(-0.17 * f64::from(i));
            let level = MAP.level(displacement);
            let there = displacement * f64::from(1u32 << level);
            let ends = displacement > 0.5 || level == 5;
            assert!(ends || (there <= 0.5 && there > 0.25), "{displacement}: level {level}");
        }
        // A texel of 1 / 4096 of the window where a pixel is a thousandth: sides of 1 / 4.096, half of their sum as much.
        assert_eq!(MAP.level(1.0 / 4.096), 1, "a pixel of a thousandth");
        assert_eq!(MAP.level(f64::MAX), 0, "a receiver edge-on to the light");
        assert_eq!(MAP.level(0.0), 5, "a pixel of the whole window");
        let fine = Virtual { rule: 0.25, ..MAP };
        assert_eq!((MAP.level(0.125), fine.level(0.125)), (2, 1), "half the displacement");
    }

    #[test]
    fn no_point_of_a_texel_is_displaced_by_more() {
        let camera = Camera {
            eye: DVec3::new(1.0, 2.0, 5.0),
            target: DVec3::ZERO,
            up: DVec3::Y,
            fov_y: 0.9,
            near: 0.1,
        };
        let camera = ViewCamera { clip: camera.view_projection(DVec3::ZERO, 1.5), eye: camera.eye };
        let window = DMat4::from_cols(
            DVec4::new(0.1, 0.03, 0.0, 0.0),
            DVec4::new(-0.02, 0.05, 0.1, 0.0),
            DVec4::new(0.04, 0.09, 0.05, 0.0),
            DVec4::W,
        );
        let pixel = |p: DVec3| {
            let ndc = camera.clip.project_point3(p);
            DVec2::new(ndc.x, -ndc.y) * 0.5 * DVec2::new(600.0, 400.0)
        };
        let (mut largest, mut compared) = (0.0_f64, 0);
        for i in 0..200 {
            let number =
                |k: i32| 2.0 * (f64::from(3 * i + k + 1) * 0.618_033_988_749_894_9).fract() - 1.0;
            let p = DVec3::new(number(0), number(1), number(2)) * 0.8;
            let n = DVec3::new(number(2) * 0.5, 1.0, 0.6 + number(0) * 0.4).normalize();
            let allowed = MAP.displacement(&window, &camera, [600, 400], (p, n));
            // From the texel's centre to its corners on the receiver's plane, made so small that derivatives hold.
            let (u, v) = n.any_orthonormal_pair();
            let step = |d: DVec3| 0.5 * 4096.0 * (window * d.extend(0.0)).truncate().truncate();
            let (su, sv) = (step(u), step(v));
            let det = su.perp_dot(sv);
            let mut farthest = 0.0_f64;
            for corner in [DVec2::new(0.5, 0.5), DVec2::new(0.5, -0.5)] {
                let (a, b) = (corner.perp_dot(sv) / det, su.perp_dot(corner) / det);
                let small = 1e-3;
                let moved = pixel(p + (u * a + v * b) * small) - pixel(p);
                farthest = farthest.max(moved.length() / small);
            }
            assert!(farthest <= allowed * (1.0 + 1e-4), "point {i}: {farthest} of {allowed}");
            largest = largest.max(farthest / allowed);
            compared += 1;
        }
        assert_eq!(compared, 200, "all points");
        assert!(largest > 0.9, "{largest}: the bound is met now and then");
    }

    #[test]
    fn the_windows_last_edge_lies_on_its_last_page() {
        for level in 0..6 {
            let last = (32 >> level) - 1;
            let page = MAP.page_of(2, DVec2::ONE, level);
            assert_eq!(page, Page { face: 2, level, tile: [last, last] }, "level {level}");
        }
    }

    #[test]
    fn a_crop_puts_the_page_into_the_middle_of_clip_space() {
        for index in (0..MAP.page_count()).step_by(7) {
            let page = MAP.page_at(index);
            let m = f64::from(32u32 >> page.level);
            for (corner, expected) in [([0.0, 0.0], [-0.5, 0.5]), ([1.0, 1.0], [0.5, -0.5])] {
                let st: [f64; 2] = [0, 1].map(|i| (f64::from(page.tile[i]) + corner[i]) / m);
                // With any w, and depth left as it is.
                let clip = DVec4::new(2.0 * st[0] - 1.0, 1.0 - 2.0 * st[1], 0.3, 1.0) * 2.5;
                let cropped = MAP.crop(page) * clip / 2.5;
                let found = [cropped.x, cropped.y, cropped.z, cropped.w];
                let wanted = [expected[0], expected[1], 0.3, 1.0];
                let off = (0..4).map(|i| f64::abs(found[i] - wanted[i])).fold(0.0, f64::max);
                assert!(off < 1e-12, "{page:?}: {found:?}");
            }
        }
    }

    #[test]
    fn ranks_grow_with_samples_eight_to_a_doubling() {
        let ranks: Vec<u32> = (1..40).map(rank_of).collect();
        assert_eq!(ranks[..5], [0, 8, 12, 16, 18], "1 to 5 samples");
        assert_eq!((ranks[15], ranks[16], ranks[17]), (32, 32, 33), "16 to 18 samples");
        assert!(ranks.windows(2).all(|pair| pair[0] <= pair[1]), "{ranks:?}");
        assert_eq!(rank_of(u32::MAX), RANKS - 1, "the last");
    }

    #[test]
    fn of_requests_beyond_the_atlas_those_of_the_fewest_samples_become_coarser() {
        let page = |level, x, y| Page { face: 0, level, tile: [x, y] };
        // 16 slots for 16 pages of 100 samples, and 4 of as few in a page of the next level.
        let many = |i: u32| page(0, i % 16, i / 16);
        let mut all: BTreeMap<Page, u32> = (0..16).map(|i| (many(2 * i), 100)).collect();
        let (least, pages) = MAP.fitting(&all);
        assert_eq!((least, pages.len()), (0, 16), "what fits is left alone");
        assert!(all.keys().all(|asked| pages.contains(asked)), "{pages:?}");
        all.remove(&many(0));
        let few: Vec<Page> = (0..4).map(|i| page(0, 30 + i % 2, 30 + i / 2)).collect();
        all.extend(few.iter().map(|few| (*few, 3)));
        let (least, pages) = MAP.fitting(&all);
        assert_eq!((least, pages.len()), (rank_of(3) + 1, 16), "more than 3 samples");
        assert!(pages.contains(&page(1, 15, 15)) && pages.contains(&many(2)), "{pages:?}");
        // None becomes coarser than where the finest levels are given up whole: two of them, as 4 x 4 pages remain.
        let spread: BTreeMap<Page, u32> =
            (0..1024).map(|i| (MAP.page_at(i), if i < 512 { 1 } else { 2 })).collect();
        let (_, pages) = MAP.fitting(&spread);
        let coarse: BTreeSet<Page> = (0..16).map(|i| page(3, i % 4, i / 4)).collect();
        assert_eq!(pages, coarse, "an atlas of 16 pages");
        let none = Virtual { row: 1, ..MAP };
        assert_eq!(none.fitting(&all).1.len(), 1, "one slot holds one page");
    }
}
