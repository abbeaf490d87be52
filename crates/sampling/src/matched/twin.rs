//! How pages are numbered and chosen, in f64: the truth of `sampling/matched.wesl` in tests.

use std::collections::BTreeSet;

use antumbra_gpu::ViewCamera;
use antumbra_map::TexelOnScreen;
use glam::{DMat4, DVec2, DVec3, DVec4};

/// A page: its level, 0 for the finest, and its place among those of its level, from the left and from the top.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Page {
    /// Level.
    pub level: u32,
    /// Column and row.
    pub tile: [u32; 2],
}

/// A virtual map and the atlas for its pages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Virtual {
    /// Side of a page, texels, a power of two.
    pub page: u32,
    /// Pages a side of the finest level, a power of two.
    pub table: u32,
    /// Pages a side of the atlas.
    pub row: u32,
    /// Texels that a pixel is to have at least.
    pub rule: f32,
}

impl Virtual {
    /// Levels, the last of which is one page.
    #[must_use]
    pub fn levels(&self) -> u32 {
        self.table.ilog2() + 1
    }

    /// Pages of all levels.
    #[must_use]
    pub fn page_count(&self) -> u32 {
        (4 * self.table * self.table - 1) / 3
    }

    /// Pages that the atlas holds.
    #[must_use]
    pub fn slots(&self) -> u32 {
        self.row * self.row
    }

    /// Place of a page among all, finest level first.
    #[must_use]
    pub fn index_of(&self, page: Page) -> u32 {
        let m = self.table >> page.level;
        4 * (self.table * self.table - m * m) / 3 + page.tile[1] * m + page.tile[0]
    }

    /// The page at a place among all.
    #[must_use]
    pub fn page_at(&self, index: u32) -> Page {
        let (mut rest, mut level, mut m) = (index, 0, self.table);
        while rest >= m * m && m > 1 {
            rest -= m * m;
            m /= 2;
            level += 1;
        }
        Page { level, tile: [rest % m, rest / m] }
    }

    /// The page that holds `page`, `by` levels coarser, but no coarser than the whole window.
    #[must_use]
    pub fn coarser(&self, page: Page, by: u32) -> Page {
        let level = (page.level + by).min(self.levels() - 1);
        Page { level, tile: page.tile.map(|t| t >> (level - page.level)) }
    }

    /// The level for a pixel that covers `texels` texels of the finest, before it is made a whole number in range.
    #[must_use]
    pub fn exact_level(&self, texels: f64) -> f64 {
        0.5 * (texels / f64::from(self.rule)).log2()
    }

    /// The level for a pixel that covers `texels` texels of the finest: the coarsest whose texels, of which the pixel
    /// has at least [`Virtual::rule`], are no larger.
    #[must_use]
    pub fn level(&self, texels: f64) -> u32 {
        let last = f64::from(self.levels() - 1);
        self.exact_level(texels).floor().clamp(0.0, last) as u32
    }

    /// The page of a level for a point of the window, which goes from (0, 0) to (1, 1).
    #[must_use]
    pub fn page_of(&self, st: DVec2, level: u32) -> Page {
        let m = self.table >> level;
        let tile = |x: f64| ((x * f64::from(m)) as u32).min(m - 1);
        Page { level, tile: [tile(st.x), tile(st.y)] }
    }

    /// Texels of the finest level that the pixel covers behind which the surface with unit normal `n` lies at `p`.
    #[must_use]
    pub fn texels_of_pixel(
        &self,
        window: &DMat4,
        camera: &ViewCamera,
        pixels: [u32; 2],
        (p, n): (DVec3, DVec3),
    ) -> f64 {
        let [width, height] = pixels.map(f64::from);
        let texels = f64::from(self.page * self.table);
        let size = DVec2::new(width, height);
        1.0 / TexelOnScreen::new(&camera.clip, size, window, texels, p, n).area()
    }

    /// By how many levels all of `requests` must become coarser to fit into the atlas, and the pages that are then in
    /// use.
    #[must_use]
    pub fn fitting(&self, requests: &BTreeSet<Page>) -> (u32, BTreeSet<Page>) {
        let coarse = |by| requests.iter().map(|&page| self.coarser(page, by)).collect();
        let pages = (0..self.levels()).map(|by| (by, coarse(by)));
        let fits = |(_, pages): &(u32, BTreeSet<Page>)| pages.len() as u32 <= self.slots();
        // The last is one page.
        pages.clone().find(fits).unwrap_or_else(|| (0, coarse(self.levels())))
    }

    /// What stretches a page's part of clip space to all of it.
    #[must_use]
    pub fn crop(&self, page: Page) -> DMat4 {
        let m = f64::from(self.table >> page.level);
        let [x, y] = page.tile.map(|t| m - 1.0 - 2.0 * f64::from(t));
        DMat4::from_cols(DVec4::X * m, DVec4::Y * m, DVec4::Z, DVec4::new(x, -y, 0.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAP: Virtual = Virtual { page: 128, table: 32, row: 4, rule: 1.0 };

    #[test]
    fn every_page_has_a_number_of_its_own() {
        // (4^6 - 1) / 3 pages of 6 levels.
        assert_eq!((MAP.page_count(), MAP.levels()), (1365, 6), "of a table of 32 x 32");
        let mut last = Page { level: 0, tile: [0, 0] };
        for index in 0..MAP.page_count() {
            let page = MAP.page_at(index);
            assert_eq!(MAP.index_of(page), index, "{page:?}");
            assert!(page.level >= last.level, "finest first");
            assert!(page.tile.iter().all(|&t| t < 32 >> page.level), "{page:?}");
            last = page;
        }
        assert_eq!(last, Page { level: 5, tile: [0, 0] }, "the last is the whole window");
    }

    #[test]
    fn texels_of_the_chosen_level_are_as_large_as_the_pixel() {
        for i in -40..100 {
            let texels = 2f64.powf(f64::from(i) * 0.17);
            let area = 4f64.powi(MAP.level(texels) as i32);
            // Between one and four texels a pixel, unless the levels end.
            let ends = texels < 1.0 || MAP.level(texels) == 5;
            assert!(ends || (area <= texels && texels < 4.0 * area), "{texels}: {area}");
        }
        // One texel of 1 / 4096 of the window a pixel of which 1000 lie across it: 4.096^2 texels, level 2.
        assert_eq!(MAP.level(4.096f64.powi(2)), 2, "a pixel of a thousandth");
        assert_eq!(MAP.level(0.0), 0, "a receiver edge-on to the light");
        assert_eq!(MAP.level(f64::INFINITY), 5, "a receiver edge-on to the camera");
        let fine = Virtual { rule: 4.0, ..MAP };
        assert_eq!((MAP.level(64.0), fine.level(64.0)), (3, 2), "four texels a pixel");
    }

    #[test]
    fn the_windows_last_edge_lies_on_its_last_page() {
        for level in 0..6 {
            let last = (32 >> level) - 1;
            let page = MAP.page_of(DVec2::ONE, level);
            assert_eq!(page, Page { level, tile: [last, last] }, "level {level}");
        }
    }

    #[test]
    fn a_crop_puts_the_page_and_nothing_else_into_clip_space() {
        for index in (0..MAP.page_count()).step_by(7) {
            let page = MAP.page_at(index);
            let m = f64::from(32u32 >> page.level);
            for (corner, expected) in [([0.0, 0.0], [-1.0, 1.0]), ([1.0, 1.0], [1.0, -1.0])] {
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
    fn requests_beyond_the_atlas_become_coarser_together() {
        // All of level 0 but one page: 1023; a quarter of it, 256; 64; and 16, which fit.
        let mut all: BTreeSet<Page> = (0..1023).map(|i| MAP.page_at(i)).collect();
        let (by, pages) = MAP.fitting(&all);
        assert_eq!((by, pages.len()), (3, 16), "of 1023 pages");
        all.insert(MAP.page_at(1364));
        assert_eq!(MAP.fitting(&all).0, 4, "one more page, of the whole window");
        let few: BTreeSet<Page> = all.into_iter().take(16).collect();
        assert_eq!(MAP.fitting(&few), (0, few.clone()), "what fits is left alone");
        let none = Virtual { row: 1, ..MAP };
        assert_eq!(none.fitting(&few).1.len(), 1, "one slot holds one page");
    }
}
