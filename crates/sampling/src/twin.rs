//! The choice of a cascade in `sampling/cascade_by_map.wesl` and `sampling/cascade_by_depth.wesl`, in f64.

use antumbra_map::FittedView;
use glam::DVec3;

use crate::Select;

/// The cascades in which a point is looked up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// The first.
    pub first: usize,
    /// The one that it hands over to.
    pub second: usize,
    /// The first one's share, in [0, 1].
    pub weight: f64,
}

impl Choice {
    fn only(i: usize) -> Self {
        Self { first: i, second: i, weight: 1.0 }
    }
}

/// Chooses among the first `count` of `views` for `p`, relative to the frame's origin. What follows them says how.
#[must_use]
pub fn choose(select: Select, count: usize, views: &[FittedView], p: DVec3) -> Choice {
    // Distance from the middle of what is farthest from it of what a kernel with this spread looks at, half widths.
    let reached = |i: usize, (spread, way): (f64, f64)| {
        let clip = views[i].clip?;
        let c = clip * p.extend(1.0);
        let row = |i: usize| clip.row(i).truncate().length();
        let metres =
            if spread == 0.0 { 0.0 } else { spread * ((1.0 - c.z).max(0.0) / row(2)).min(way) };
        let off = [0, 1].map(|i| c[i].abs() + metres * row(i));
        (c.w > 0.0).then(|| off[0].max(off[1]) / c.w)
    };
    let covers = |i: usize| reached(i, (0.0, 0.0)).is_some_and(|off| off <= 1.0);
    match select {
        Select::Map => {
            let border = views[count].light;
            let off = |i: usize| reached(i, (border.z, border.w));
            let mut holding =
                (0..count).filter_map(|i| Some((i, off(i).filter(|o| *o <= border.x)?)));
            let Some((first, off)) = holding.next() else {
                let mut covering = (0..count).filter(|i| covers(*i));
                let found = if border.z > 0.0 { covering.next_back() } else { covering.next() };
                return Choice::only(found.unwrap_or(0));
            };
            let weight = (border.x - off) * border.y;
            match holding.next() {
                Some((second, _)) if weight < 1.0 => Choice { first, second, weight },
                _ => Choice::only(first),
            }
        }
        Select::Depth => {
            let before = |i: usize| views[count + i].light.dot(p.extend(1.0));
            match (0..count - 1).find(|i| before(*i) > 0.0) {
                Some(i) if before(i) < 1.0 && covers(i + 1) => {
                    Choice { first: i, second: i + 1, weight: before(i) }
                }
                Some(i) => Choice::only(i),
                None => Choice::only(count - 1),
            }
        }
    }
}
