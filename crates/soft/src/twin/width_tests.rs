//! Widths against brute force, the attenuation function's axioms, and the cases that theory decides.

use std::collections::BTreeMap;

use glam::{DVec2, IVec2};

use super::{
    MAX_DOUBLINGS, Step, UNREACHED, attenuation, doubled, doubling, doublings_for, width_map,
};
use crate::{SingleSample, Widths};

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

const SIZE: i32 = 40;

/// Bodies of several texels with holes of one.
fn masks() -> Vec<Vec<bool>> {
    let mut random = Random(3);
    let mut mask = |holes: f64| {
        let discs: Vec<(DVec2, f64)> = (0..4)
            .map(|_| {
                let center = 40.0 * DVec2::new(random.next(), random.next());
                (center, 3.0 + 12.0 * random.next())
            })
            .collect();
        let blocked = |i: i32| {
            let p = DVec2::new(f64::from(i % SIZE), f64::from(i / SIZE));
            discs.iter().any(|(center, radius)| p.distance(*center) < *radius)
        };
        (0..SIZE * SIZE).map(|i| blocked(i) && random.next() >= holes).collect::<Vec<bool>>()
    };
    let mut all = vec![mask(0.0), mask(0.02), mask(0.2)];
    all.push(vec![true; (SIZE * SIZE) as usize]);
    all.push((0..SIZE * SIZE).map(|i| i != 20 * SIZE + 20).collect());
    all
}

const SIDES: [DVec2; 2] = [DVec2::ONE, DVec2::new(1.0, 1.625)];

/// The shortest way to any lit texel by any set of the steps, one of each pass at most: by composing all ways first.
fn brute_force(blocked: &[bool], passes: &[Vec<Step>]) -> Vec<f64> {
    let mut ways = BTreeMap::from([((0, 0), 0.0)]);
    for steps in passes {
        let before = ways.clone();
        for ((x, y), length) in &before {
            for step in steps {
                let to = IVec2::new(*x, *y) + step.offset;
                let way = ways.entry((to.x, to.y)).or_insert(f64::INFINITY);
                *way = way.min(length + step.length);
            }
        }
    }
    let lit = |p: IVec2| {
        let inside = p.min_element() >= 0 && p.max_element() < SIZE;
        !inside || !blocked[(p.y * SIZE + p.x) as usize]
    };
    (0..SIZE * SIZE)
        .map(|i| {
            let p = IVec2::new(i % SIZE, i / SIZE);
            let found = ways.iter().filter(|((x, y), _)| lit(p + IVec2::new(*x, *y)));
            found.map(|(_, length)| *length).fold(UNREACHED, f64::min)
        })
        .collect()
}

/// The distance to the nearest lit texel, the border's surroundings included.
fn distances(blocked: &[bool], metric: impl Fn(IVec2) -> f64) -> Vec<f64> {
    let around = || (-1..=SIZE).flat_map(|y| (-1..=SIZE).map(move |x| IVec2::new(x, y)));
    let inside = |p: IVec2| p.min_element() >= 0 && p.max_element() < SIZE;
    let lit: Vec<IVec2> =
        around().filter(|p| !inside(*p) || !blocked[(p.y * SIZE + p.x) as usize]).collect();
    (0..SIZE * SIZE)
        .map(|i| {
            let p = IVec2::new(i % SIZE, i / SIZE);
            lit.iter().map(|q| metric(p - q)).fold(f64::INFINITY, f64::min)
        })
        .collect()
}

fn config(widths: Widths, neighbours: u32) -> SingleSample {
    SingleSample { widths, neighbours, ..SingleSample::default() }
}

#[test]
fn doubling_gives_the_shortest_way_bit_for_bit_and_no_order_of_passes_matters() {
    const DOUBLINGS: u32 = 4;
    for sides in SIDES {
        for neighbours in [3, 4, 6, 8] {
            let steps: Vec<Vec<Step>> =
                (0..DOUBLINGS).map(|k| doubling(neighbours, k, sides)).collect();
            for blocked in masks() {
                let found =
                    width_map(&config(Widths::Doubling, neighbours), DOUBLINGS, &blocked, sides);
                let expected = brute_force(&blocked, &steps);
                assert_eq!(found, expected, "{neighbours} neighbours, sides {sides}");
                // Away from the border, where a way may leave the map and not come back.
                let start: Vec<f64> =
                    blocked.iter().map(|b| if *b { UNREACHED } else { 0.0 }).collect();
                let back = steps.iter().rev().fold(start, |w, steps| doubled(&w, SIZE, steps));
                let far = (SIZE / 2 - 2)..(SIZE / 2 + 2);
                for y in far.clone() {
                    for x in far.clone() {
                        let i = (y * SIZE + x) as usize;
                        assert_eq!(back[i], found[i], "{neighbours} neighbours, backwards");
                    }
                }
                // The control: one step that is a texel off.
                let mut wrong = steps.clone();
                wrong[1][0].offset.x += 1;
                let other = brute_force(&blocked, &wrong);
                assert!(blocked.iter().all(|b| *b) || other != found, "a wrong step shows");
            }
        }
    }
}

#[test]
fn sweeps_give_the_distance_along_rows_and_columns_and_in_the_plane() {
    for sides in SIDES {
        for blocked in masks() {
            let city = width_map(&config(Widths::CityBlock, 4), 0, &blocked, sides);
            let expected = distances(&blocked, |d| {
                let d = d.abs().as_dvec2() * sides;
                d.x + d.y
            });
            assert_eq!(city, expected, "along rows and columns");
            let plane = width_map(&config(Widths::Euclidean, 4), 0, &blocked, sides);
            let expected = distances(&blocked, |d| (d.as_dvec2() * sides).length());
            for (a, b) in plane.iter().zip(&expected) {
                assert!((a - b).abs() <= 1e-12 * b, "in the plane: {a}, not {b}");
            }
        }
    }
}

/// Widths of a half-plane whose border runs at an angle, over the true ones.
fn ratios(neighbours: u32, degrees: f64) -> Vec<f64> {
    const HALF: i32 = 64;
    let size = 2 * HALF + 1;
    let normal = DVec2::from_angle(degrees.to_radians());
    let depth = |x: i32, y: i32| normal.dot(DVec2::new(f64::from(x - HALF), f64::from(y - HALF)));
    let texels = || (0..size).flat_map(move |y| (0..size).map(move |x| (x, y)));
    let blocked: Vec<bool> = texels().map(|(x, y)| depth(x, y) > 0.0).collect();
    let found = width_map(&config(Widths::Doubling, neighbours), 6, &blocked, DVec2::ONE);
    // Around the middle, where the border of the map is farther than that of the shadow.
    let near = |x: i32, y: i32| (x - HALF).abs().max((y - HALF).abs()) <= 24;
    texels()
        .zip(&found)
        .filter(|((x, y), _)| near(*x, *y) && depth(*x, *y) > 8.0 && depth(*x, *y) < 24.0)
        .map(|((x, y), found)| found / depth(x, y))
        .collect()
}

#[test]
fn widths_of_half_planes_are_too_large_between_the_directions_of_the_neighbours() {
    let mean = |r: &[f64]| r.iter().sum::<f64>() / r.len() as f64;
    for neighbours in [3, 4, 6, 8] {
        let (mut least, mut most) = (f64::INFINITY, 0.0f64);
        for degrees in [0.0, 7.5, 15.0, 22.5, 30.0, 37.5, 45.0, 60.0, 75.0, 90.0] {
            let ratios = ratios(neighbours, degrees);
            assert!(!ratios.is_empty(), "texels to look at");
            // Steps are as long as they are, so that no way is shorter than the distance; half a step of 1/64 is rounding's,
            // for each of six steps.
            let shortest = ratios.iter().copied().fold(f64::INFINITY, f64::min);
            assert!(shortest > 1.0 - 6.0 / 128.0 / 8.0, "{neighbours} neighbours: {shortest}");
            (least, most) = (least.min(mean(&ratios)), most.max(mean(&ratios)));
        }
        // Midway between two directions a half-plane is as far as one of them leads: 1 / cos of half the angle between,
        // 60, 45, 30 and 22.5 degrees, but for a border that is itself made of texels.
        let limit = match neighbours {
            3 => 2.0,
            4 => 2f64.sqrt(),
            6 => 2.0 / 3f64.sqrt(),
            _ => 1.0 / 22.5f64.to_radians().cos(),
        };
        assert!(least < 1.1 && most < 1.1 * limit, "{neighbours}: {least} to {most}, not {limit}");
        assert!(most > 0.9 * limit || neighbours == 3, "{neighbours} neighbours: {most}");
    }
}

#[test]
fn one_lit_texel_is_out_of_reach_of_some() {
    // Of the texels within 40 of a pinhole, the share that never hears of it: one step of each length at most.
    const HALF: i32 = 64;
    let size = 2 * HALF + 1;
    let center = IVec2::splat(HALF);
    let blocked: Vec<bool> = (0..size * size).map(|i| i != HALF * size + HALF).collect();
    let share = |neighbours| {
        let steps: Vec<_> = (0..6).map(|k| doubling(neighbours, k, DVec2::ONE)).collect();
        // Only ways that stay within the map count: the border is lit, too.
        let mut reached = std::collections::BTreeSet::from([(0, 0)]);
        for steps in &steps {
            for (x, y) in reached.clone() {
                reached.extend(steps.iter().map(|s| (x + s.offset.x, y + s.offset.y)));
            }
        }
        let near = |p: &IVec2| (*p - center).as_dvec2().length() <= 40.0;
        let all: Vec<IVec2> =
            (0..size * size).map(|i| IVec2::new(i % size, i / size)).filter(near).collect();
        let missed = all.iter().filter(|p| !reached.contains(&(center.x - p.x, center.y - p.y)));
        missed.count() as f64 / all.len() as f64
    };
    assert_eq!(blocked.iter().filter(|b| !**b).count(), 1, "a pinhole");
    let [three, four, six, eight] = [3, 4, 6, 8].map(share);
    assert!((four - 0.33).abs() < 0.01, "4 neighbours: {four}");
    assert!(three > four && six < 0.01 && eight < 0.01, "{three}, {four}, {six}, {eight}");
}

#[test]
fn the_attenuation_function_keeps_its_axioms() {
    let mut random = Random(9);
    for _ in 0..100_000 {
        let mut positive = || 10f64.powf(8.0 * random.next() - 4.0);
        let (depth, width, factor) = (positive(), positive(), positive());
        let (more, scale) = (width * (1.0 + positive()), positive());
        let light = |depth, width| attenuation(depth, width, scale, 0.0);
        let found = light(depth, width);
        assert!((0.0..=1.0).contains(&found), "{found}");
        assert_eq!(light(0.0, width), 1.0, "no depth");
        assert_eq!(light(depth, 0.0), 1.0, "no width");
        // Light is a function of width / depth: a product and a quotient of three roundings each.
        let tolerance = 8.0 * f64::EPSILON * (1.0 + scale * width / depth);
        let scaled = light(depth * factor, width * factor);
        assert!((scaled - found).abs() <= tolerance, "{scaled}, not {found}");
        // Darker inwards, and the more so the nearer the occluder, strictly where there is light and rounding lets it show.
        let inner = light(depth, more);
        let nearer = light(depth * width / more, width);
        let shows = scale * (more - width) / depth > 1e-12;
        assert!(inner <= found && (inner < found || found == 0.0 || !shows), "{inner}, {found}");
        assert!(nearer <= found + tolerance, "{nearer}, {found}");
    }
    // With a bias light is whole up to a width of bias / scale, and there is no strictness there: the control.
    assert_eq!(attenuation(1.0, 0.01, 1.0, 0.05), attenuation(1.0, 0.02, 1.0, 0.05), "bias");
}

#[test]
fn the_cases_of_the_literature_that_theory_decides() {
    // A light of half size 0.05 a metre. An endless strip of half width 0.1, 3 m up: 1 - 0.1 / 0.15, which is right under a
    // square light; and dark for 0.2.
    let light = |width: f64, gap: f64| attenuation(0.05 * gap, width, 1.0, 0.0);
    assert!((light(0.1, 3.0) - 1.0 / 3.0).abs() < 1e-12, "a strip of 0.2 m");
    assert_eq!(light(0.2, 3.0), 0.0, "a strip of 0.4 m");
    // A disc of radius 0.1, 6 m up, under a round light: 2/3, where 1 - (1/3)^2 is right.
    assert!((light(0.1, 6.0) - 2.0 / 3.0).abs() < 1e-12, "a small disc");
}

#[test]
fn as_many_doublings_as_reach_the_widest_penumbra() {
    for (width, size, neighbours, expected) in [
        (0.0, 512, 6, 1),
        (1.0, 512, 6, 1),
        (1.5, 512, 6, 2),
        (3.0, 512, 6, 2),
        (63.0, 512, 6, 6),
        (64.0, 512, 6, 7),
        (1e9, 255, 3, 8),
        (1e9, 253, 4, 7),
        (f64::INFINITY, 8192, 8, 13),
        (f64::INFINITY, 16384, 3, MAX_DOUBLINGS),
        (f64::NAN, 1, 6, 1),
    ] {
        let found = doublings_for(width, size, neighbours);
        assert_eq!(found, expected, "{width} texels of {size}, {neighbours} neighbours");
    }
    // From the middle of a map that is dark all over.
    for neighbours in [3, 4, 6, 8] {
        let dark = vec![true; (SIZE * SIZE) as usize];
        let doublings = doublings_for(1e9, SIZE as u32, neighbours);
        let reached =
            width_map(&config(Widths::Doubling, neighbours), doublings, &dark, DVec2::ONE);
        assert!(reached.iter().all(|w| *w < UNREACHED), "{neighbours} neighbours");
    }
}
