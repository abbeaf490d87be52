//! From triangles to an eight-wide tree.
//!
//! A binary tree (PLOC, Meister and Bittner 2018, with a bound on its passes, improved by the parallel
//! reinsertion of Meister and Bittner 2017, by `obvhs`) is collapsed into nodes of eight children and leaves of up to eight
//! triangles by the dynamic programme of Ylitie, Karras and Laine 2017 (section 3.1), which finds the
//! cut of least surface-area cost.

use antumbra_scene::Triangles;
use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::bvh2::{Bvh2, DEFAULT_MAX_STACK_DEPTH};
use obvhs::ploc::morton::morton_encode_u64_unorm;
use rayon::prelude::*;

/// Lanes of a node and of a packet.
pub(super) const WIDTH: usize = 8;

/// Marks a child that is a packet; the other bits are its index.
pub(super) const LEAF: u32 = 1 << 31;

/// Expected time to test a packet over that to test a node. The operations of the two kernels give
/// 45 to 17, but most packets lie further from the processor than the few nodes near the root.
const PACKET_COST: f32 = 2.0;

/// Eight boxes and what lies in them.
#[derive(Clone)]
#[repr(C, align(64))]
pub(super) struct Node {
    /// Lower and upper plane of each axis: row 2 * axis + (0 lower, 1 upper). Vacant lanes have
    /// lower +infinity and upper -infinity, which no ray meets.
    pub(super) planes: [[f32; WIDTH]; 6],
    /// A node, or a packet if marked [`LEAF`].
    pub(super) children: [u32; WIDTH],
}

/// Up to eight triangles; the last one fills the vacant lanes.
#[derive(Clone)]
#[repr(C, align(64))]
pub(super) struct Packet {
    /// Coordinates, by axis, corner and lane.
    pub(super) corners: [[[f32; WIDTH]; 3]; 3],
    /// Indices into the triangle list.
    pub(super) triangles: [u32; WIDTH],
}

/// The eight-wide tree. `nodes` is empty where there are no triangles; else node 0 is the root.
#[derive(Clone, Default)]
pub(super) struct Tree {
    pub(super) nodes: Vec<Node>,
    pub(super) packets: Vec<Packet>,
    /// Entries that the traversal's stack may need, with room for one full node beyond the last.
    pub(super) stack: usize,
}

/// Triangles with one and the same box: no tree can tell them apart.
struct Group {
    bounds: Aabb,
    /// Range in the order of triangles.
    first: usize,
    count: usize,
}

/// The triangles' indices, equal boxes together, and the groups of equal boxes.
fn group(list: &Triangles) -> (Vec<u32>, Vec<Group>) {
    let bounds = |t: u32| {
        let corners = list.triangles[t as usize].map(|i| Vec3A::from(list.positions[i as usize]));
        let [a, b, c] = corners;
        Aabb::new(a.min(b).min(c), a.max(b).max(c))
    };
    let key = |t: u32| {
        let Aabb { min, max } = bounds(t);
        [min.x, min.y, min.z, max.x, max.y, max.z].map(f32::to_bits)
    };
    let mut order: Vec<([u32; 6], u32)> =
        (0..list.triangles.len() as u32).into_par_iter().map(|t| (key(t), t)).collect();
    order.par_sort_unstable();
    let mut groups: Vec<Group> = Vec::new();
    for (i, &(key, t)) in order.iter().enumerate() {
        match groups.last_mut() {
            Some(last) if order[last.first].0 == key => last.count += 1,
            _ => groups.push(Group { bounds: bounds(t), first: i, count: 1 }),
        }
    }
    // In the order of the list, in which neighbours are often neighbours in space.
    groups.par_sort_unstable_by_key(|g| order[g.first].1);
    (order.into_iter().map(|(_, t)| t).collect(), groups)
}

/// Boxes that a random line through the scene meets, up to which nodes are reinserted where they fit
/// best; a city has tens. The search for a place takes about as many steps, so that among boxes that
/// overlap in thousands the time would grow with the square of their number.
const MOST_CROSSED: f32 = 500.0;

/// Clusters looked at before and after each one (Meister and Bittner 2018 call it r).
const REACH: usize = 14;

/// The binary tree: PLOC. In Z-order of their centres, clusters that are each other's best neighbour
/// merge, pass after pass.
///
/// On boxes inside each other, only the innermost two agree, and a million would take a million
/// passes. A pass in which less than 1/16 agree is replaced by one that merges the two of every pair
/// in Z-order. So all passes together look at less than 16 n clusters.
fn cluster(groups: &[Group]) -> Bvh2 {
    let bounds = groups.iter().fold(Aabb::empty(), |all, g| all.union(&g.bounds));
    let scale = 1.0 / bounds.diagonal().as_dvec3().max(DVec3::splat(f64::MIN_POSITIVE));
    let mut codes: Vec<(u64, u32)> = groups
        .par_iter()
        .enumerate()
        .map(|(i, g)| {
            let center = (g.bounds.center() - bounds.min).as_dvec3() * scale;
            (morton_encode_u64_unorm(center), i as u32)
        })
        .collect();
    codes.par_sort_unstable();
    let leaf =
        |(i, &(_, g)): (usize, &(u64, u32))| Bvh2Node::new(groups[g as usize].bounds, 1, i as u32);
    let mut clusters: Vec<Bvh2Node> = codes.iter().enumerate().map(leaf).collect();
    let mut nodes = vec![Bvh2Node::default(); 2 * clusters.len() - 1];
    // Filled from the back, so that children come after their parents.
    let mut free = nodes.len();
    let mut next = Vec::with_capacity(clusters.len());
    let mut depth = 0;
    while clusters.len() > 1 {
        let mut partners = best_neighbours(&clusters);
        let agree = |i: usize, partners: &[usize]| partners[partners[i]] == i;
        let pairs = (0..clusters.len()).filter(|&i| partners[i] > i && agree(i, &partners)).count();
        if pairs < clusters.len() / 16 {
            partners = (0..clusters.len()).map(|i| (i ^ 1).min(clusters.len() - 1)).collect();
        }
        next.clear();
        for (i, &cluster) in clusters.iter().enumerate() {
            let partner = partners[i];
            if partner == i || !agree(i, &partners) {
                next.push(cluster);
            } else if partner > i {
                free -= 2;
                nodes[free] = cluster;
                nodes[free + 1] = clusters[partner];
                let bounds = cluster.aabb().union(clusters[partner].aabb());
                next.push(Bvh2Node::new(bounds, 0, free as u32));
            }
        }
        std::mem::swap(&mut clusters, &mut next);
        depth += 1;
    }
    nodes[0] = clusters[0];
    Bvh2 {
        nodes,
        primitive_indices: codes.into_iter().map(|(_, g)| g).collect(),
        children_are_ordered_after_parents: true,
        max_depth: DEFAULT_MAX_STACK_DEPTH.max(depth + 1),
        ..Bvh2::default()
    }
}

/// For each cluster the one within [`REACH`] with which it has the smallest common box; among equals
/// the one whose index differs in the lowest bit, so that the two of a pair choose each other.
fn best_neighbours(clusters: &[Bvh2Node]) -> Vec<usize> {
    let best = |i: usize| {
        let near = i.saturating_sub(REACH)..(i + REACH + 1).min(clusters.len());
        let cost = |j: usize| clusters[i].aabb().union(clusters[j].aabb()).half_area();
        near.filter(|&j| j != i)
            .map(|j| (cost(j), i ^ j))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
            .map_or(i, |(_, bits)| i ^ bits)
    };
    (0..clusters.len()).into_par_iter().with_min_len(1024).map(best).collect()
}

/// Builds the tree over valid triangles.
pub(super) fn build(list: &Triangles) -> Tree {
    if list.triangles.is_empty() {
        return Tree::default();
    }
    let (order, groups) = group(list);
    let mut binary = cluster(&groups);
    let root = binary.nodes[0].aabb().half_area();
    let crossed = binary.nodes.iter().map(|n| n.aabb().half_area()).sum::<f32>() / root;
    if crossed <= MOST_CROSSED {
        // All nodes are candidates: twice the time of a fifth of them, for 2 to 4 % faster rays on a
        // city.
        ReinsertionOptimizer::default().run(&mut binary, 1.0, None);
    }
    Collapse::new(&binary, list, &order, &groups).tree()
}

/// The collapse of a binary tree.
struct Collapse<'a> {
    binary: &'a Bvh2,
    list: &'a Triangles,
    order: &'a [u32],
    groups: &'a [Group],
    /// `cost[n][i]`: least cost of the triangles below n in at most i nodes or leaves, i in 1..=7.
    cost: Vec<[f32; WIDTH]>,
    /// `split[n][i]`: how many of the i go to the left child; 0: as for i - 1. `split[n][1]`: 1 if n
    /// becomes a leaf. `split[n][0]`: the left child's share of the eight if n becomes a node.
    split: Vec<[u8; WIDTH]>,
}

impl<'a> Collapse<'a> {
    fn new(binary: &'a Bvh2, list: &'a Triangles, order: &'a [u32], groups: &'a [Group]) -> Self {
        let count = binary.nodes.len();
        let mut this = Self {
            binary,
            list,
            order,
            groups,
            cost: vec![[0.0; WIDTH]; count],
            split: vec![[0; WIDTH]; count],
        };
        // Parents before children; the programme runs backwards.
        let mut order = vec![0_usize];
        let mut next = 0;
        while next < order.len() {
            let node = &binary.nodes[order[next]];
            if !node.is_leaf() {
                let left = node.first_index as usize;
                order.extend([left, left + 1]);
            }
            next += 1;
        }
        let mut triangles = vec![0_u32; count];
        for &n in order.iter().rev() {
            let node = &binary.nodes[n];
            let area = node.aabb().half_area();
            if node.is_leaf() {
                let count = this.triangles(n).len();
                triangles[n] = count as u32;
                this.cost[n] = [area * PACKET_COST * count.div_ceil(WIDTH) as f32; WIDTH];
                // A group too large for a packet becomes nodes when it is written.
                this.split[n][1] = u8::from(count <= WIDTH);
                continue;
            }
            let left = node.first_index as usize;
            triangles[n] = triangles[left].saturating_add(triangles[left + 1]);
            let (whole, share) = this.distribute(left, WIDTH);
            this.split[n][0] = share;
            let inner = whole + area;
            let leaf =
                if triangles[n] as usize <= WIDTH { area * PACKET_COST } else { f32::INFINITY };
            this.split[n][1] = u8::from(leaf <= inner);
            this.cost[n][1] = leaf.min(inner);
            for i in 2..WIDTH {
                let (cost, share) = this.distribute(left, i);
                let single = this.cost[n][i - 1];
                (this.cost[n][i], this.split[n][i]) =
                    if cost < single { (cost, share) } else { (single, 0) };
            }
        }
        this
    }

    /// The cheapest way to give `slots` >= 2 to the children `left` and `left + 1`, and how many of
    /// the slots go to the left one.
    fn distribute(&self, left: usize, slots: usize) -> (f32, u8) {
        (1..slots)
            .map(|k| (self.cost[left][k] + self.cost[left + 1][slots - k], k as u8))
            .fold((f32::INFINITY, 1), |best, this| if this.0 < best.0 { this } else { best })
    }

    /// The roots that the `slots` given to `n` are spent on.
    fn roots(&self, n: usize, slots: usize, out: &mut Vec<usize>) {
        match self.split[n][slots] {
            _ if slots == 1 => out.push(n),
            0 => self.roots(n, slots - 1, out),
            k => {
                let left = self.binary.nodes[n].first_index as usize;
                self.roots(left, k.into(), out);
                self.roots(left + 1, slots - usize::from(k), out);
            }
        }
    }

    /// The triangles of a leaf of the binary tree.
    fn triangles(&self, leaf: usize) -> &'a [u32] {
        let node = &self.binary.nodes[leaf];
        debug_assert_eq!(node.prim_count, 1, "PLOC makes leaves of one primitive");
        let group = self.binary.primitive_indices[node.first_index as usize] as usize;
        let Group { first, count, .. } = self.groups[group];
        &self.order[first..first + count]
    }

    /// All triangles below `n`.
    fn gather(&self, n: usize, out: &mut Vec<u32>) {
        let node = &self.binary.nodes[n];
        if node.is_leaf() {
            out.extend(self.triangles(n));
        } else {
            self.gather(node.first_index as usize, out);
            self.gather(node.first_index as usize + 1, out);
        }
    }

    fn packet(&self, triangles: &[u32]) -> Packet {
        let lanes: [u32; WIDTH] = std::array::from_fn(|i| triangles[i.min(triangles.len() - 1)]);
        let corners = std::array::from_fn(|axis| {
            std::array::from_fn(|corner| {
                lanes.map(|t| {
                    let index = self.list.triangles[t as usize][corner];
                    self.list.positions[index as usize][axis]
                })
            })
        });
        Packet { corners, triangles: lanes }
    }

    /// What the wide node for `part` holds: at most eight parts.
    fn parts(&self, part: Part<'a>) -> Vec<Part<'a>> {
        match part {
            Part::Group(bounds, triangles) => triangles
                .chunks(triangles.len().div_ceil(WIDTH).max(WIDTH))
                .map(|chunk| Part::Group(bounds, chunk))
                .collect(),
            Part::Tree(n) if self.split[n][1] == 1 => vec![part],
            Part::Tree(n) if self.binary.nodes[n].is_leaf() => {
                self.parts(Part::Group(*self.binary.nodes[n].aabb(), self.triangles(n)))
            }
            Part::Tree(n) => {
                let mut roots = Vec::with_capacity(WIDTH);
                let left = self.binary.nodes[n].first_index as usize;
                let share = usize::from(self.split[n][0]);
                self.roots(left, share, &mut roots);
                self.roots(left + 1, WIDTH - share, &mut roots);
                roots.into_iter().map(Part::Tree).collect()
            }
        }
    }

    fn bounds(&self, part: Part<'a>) -> Aabb {
        match part {
            Part::Tree(n) => *self.binary.nodes[n].aabb(),
            Part::Group(bounds, _) => bounds,
        }
    }

    fn fits_packet(&self, part: Part<'a>) -> bool {
        match part {
            Part::Tree(n) => self.split[n][1] == 1,
            Part::Group(_, triangles) => triangles.len() <= WIDTH,
        }
    }

    fn tree(&self) -> Tree {
        let mut tree = Tree::default();
        let mut triangles = Vec::new();
        // What becomes a wide node, where its index is to be written, and the number of stack
        // entries below it.
        let mut todo = vec![(Part::Tree(0), None, 0)];
        while let Some((part, parent, below)) = todo.pop() {
            let index = tree.nodes.len() as u32;
            if let Some((node, lane)) = parent {
                let node: &mut Node = &mut tree.nodes[node as usize];
                node.children[lane] = index;
            }
            let mut parts = self.parts(part);
            // The last child is visited first: packets, as they may end the search, and large boxes,
            // as they are likely to be hit.
            parts.sort_by(|&a, &b| {
                let key = |part| (self.fits_packet(part), self.bounds(part).half_area());
                key(a).partial_cmp(&key(b)).expect("areas of finite boxes are numbers")
            });
            let mut node = Node {
                planes: std::array::from_fn(|row| {
                    [if row % 2 == 0 { f32::INFINITY } else { f32::NEG_INFINITY }; WIDTH]
                }),
                children: [0; WIDTH],
            };
            tree.stack = tree.stack.max(below + 2 * WIDTH);
            for (lane, &part) in parts.iter().enumerate() {
                let bounds = self.bounds(part);
                for axis in 0..3 {
                    node.planes[2 * axis][lane] = bounds.min[axis];
                    node.planes[2 * axis + 1][lane] = bounds.max[axis];
                }
                if self.fits_packet(part) {
                    triangles.clear();
                    match part {
                        Part::Tree(n) => self.gather(n, &mut triangles),
                        Part::Group(_, group) => triangles.extend(group),
                    }
                    node.children[lane] = LEAF | tree.packets.len() as u32;
                    tree.packets.push(self.packet(&triangles));
                } else {
                    todo.push((part, Some((index, lane)), below + parts.len() - 1));
                }
            }
            tree.nodes.push(node);
        }
        tree
    }
}

/// What a child of a wide node is made from.
#[derive(Clone, Copy)]
enum Part<'a> {
    /// A node of the binary tree with all below it.
    Tree(usize),
    /// Triangles with the same box.
    Group(Aabb, &'a [u32]),
}
