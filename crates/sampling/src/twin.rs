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
    // Distance from the middle, half widths.
    let off = |i: usize| {
        let c = views[i].clip? * p.extend(1.0);
        (c.w > 0.0).then(|| c.x.abs().max(c.y.abs()) / c.w)
    };
    let covers = |i: usize| off(i).is_some_and(|off| off <= 1.0);
    match select {
        Select::Map => {
            let border = views[count].light;
            let mut holding =
                (0..count).filter_map(|i| Some((i, off(i).filter(|o| *o <= border.x)?)));
            let Some((first, off)) = holding.next() else {
                return Choice::only((0..count).find(|i| covers(*i)).unwrap_or(0));
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
