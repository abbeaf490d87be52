use antumbra_scene::generate::{self, shapes};
use antumbra_scene::{Mesh, Scene};
use glam::{DAffine3, DVec3, Vec3};

use super::*;

fn edges(mesh: &Mesh) -> Edges {
    Edges::new(&mesh.positions, &mesh.triangles)
}

/// Every vertex of every triangle on its own, as texture coordinates may demand.
fn split(mesh: &Mesh) -> Mesh {
    let corners = mesh.triangles.iter().flatten();
    Mesh {
        name: mesh.name.clone(),
        positions: corners.map(|&i| mesh.positions[i as usize]).collect(),
        triangles: (0..mesh.triangles.len() as u32)
            .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
            .collect(),
    }
}

#[test]
fn a_cube_is_one_closed_body_of_18_edges_each_used_once_each_way() {
    let cube = shapes::cuboid(DVec3::ZERO, DVec3::ONE);
    for mesh in [cube.clone(), split(&cube)] {
        let edges = edges(&mesh);
        assert_eq!(edges.len(), 18, "12 of the cube and a diagonal a face");
        assert_eq!((edges.not_manifold, edges.not_watertight), (None, None), "closed");
        let expected = Body { min: [0.0; 3], outward: 1.0, max: [1.0; 3], unused: 0.0 };
        assert_eq!(edges.bodies, [expected], "one body, wound outwards");
        assert!(edges.body.iter().all(|&b| b == 0), "all triangles are of it");
    }
}

#[test]
fn splitting_vertices_changes_no_use_of_any_edge() {
    for mesh in [generate::pages(5), generate::moebius(16, 1.0, 0.4), shapes::icosphere(2, 1.0)] {
        let uses = |mesh: &Mesh| {
            // Edges are numbered by their vertices' order, and a use's direction follows it: which two
            // triangles meet, and whether in the same direction, does not.
            let edges = edges(mesh);
            let mut all: Vec<Vec<(usize, bool)>> = (0..edges.len())
                .map(|e| {
                    let first = edges.uses_of(e).next().expect("an edge has a use").1;
                    edges.uses_of(e).map(|(t, back)| (t, back != first)).collect()
                })
                .collect();
            all.sort();
            all
        };
        assert_eq!(uses(&mesh), uses(&split(&mesh)), "{}", mesh.name);
    }
}

#[test]
fn a_sheet_is_manifold_but_not_watertight() {
    let edges = edges(&shapes::floor(1.0));
    assert_eq!(edges.len(), 5, "four sides and a diagonal");
    assert_eq!(edges.not_manifold, None, "no edge has two uses in one direction");
    let fault = edges.not_watertight.expect("a border");
    assert_eq!(fault.along + fault.against, 1, "an edge with one triangle: {fault:?}");
    let outward: Vec<f32> = edges.bodies.iter().map(|b| b.outward).collect();
    assert_eq!((&*outward, &*edges.body), (&[0.0][..], &[0, 0][..]), "one open body");
}

#[test]
fn three_triangles_on_one_edge_and_a_moebius_strip_are_no_manifolds() {
    let fan = edges(&generate::pages(3));
    let fault = EdgeFault { vertices: [0, 1], along: 3, against: 0 };
    assert_eq!(fan.not_manifold, Some(fault), "the shared edge");
    assert_eq!(
        fan.uses_of(0).collect::<Vec<_>>(),
        [(0, false), (1, false), (2, false)],
        "its uses"
    );
    let strip = edges(&generate::moebius(64, 1.0, 0.4));
    let fault = strip.not_manifold.expect("somewhere the winding turns");
    assert!(fault.along == 2 || fault.against == 2, "{fault:?}");
}

#[test]
fn a_body_wound_inwards_is_known_as_such_and_bodies_that_share_an_edge_are_not_closed() {
    let cube = |low: f64| shapes::cuboid(DVec3::splat(low), DVec3::splat(low + 1.0));
    let mut inward = cube(3.0);
    inward.triangles.iter_mut().for_each(|t| t.reverse());
    let mut both = cube(0.0);
    both.append(&inward);
    let outward: Vec<f32> = edges(&both).bodies.iter().map(|b| b.outward).collect();
    assert_eq!(outward, [1.0, -1.0], "outward, inward");
    let mut touching = cube(0.0);
    touching.append(&shapes::cuboid(DVec3::new(1.0, 1.0, 0.0), DVec3::new(2.0, 2.0, 1.0)));
    let edges = edges(&touching);
    assert_eq!(edges.bodies.len(), 1, "they hang together");
    assert_eq!(edges.bodies[0].outward, 0.0, "four triangles meet at the shared edge");
    let fault = edges.not_manifold.expect("the shared edge");
    assert_eq!((fault.along, fault.against), (2, 2), "{fault:?}");
}

#[test]
fn degenerate_triangles_have_no_edges_and_zero_has_no_sign() {
    let positions = [Vec3::ZERO, Vec3::new(-0.0, 0.0, -0.0), Vec3::X, Vec3::Y];
    let edges = Edges::new(&positions, &[[0, 1, 2], [2, 2, 2], [1, 2, 3]]);
    assert_eq!(edges.vertices, [[0, 2], [0, 3], [2, 3]], "those of the last triangle, welded");
    assert_eq!(edges.uses, [4, 5, 4], "each of the last triangle");
    assert_eq!(Edges::new(&[], &[]).first, [0], "nothing has no edges");
}

#[test]
fn instances_are_bodies_of_their_own() {
    let mut scene = Scene::default();
    for x in 0..3 {
        let place = DAffine3::from_translation(DVec3::X * 2.0 * f64::from(x));
        scene.add(shapes::icosphere(1, 0.5), place);
    }
    let triangles = scene.triangles(DVec3::ZERO).expect("a sound scene");
    let edges = Edges::new(&triangles.positions, &triangles.triangles);
    assert_eq!(edges.bodies.len(), 3, "three bodies");
    assert!(edges.bodies.iter().all(|b| b.outward == 1.0), "all closed");
    assert_eq!(edges.len(), 3 * 120, "an icosphere of 80 triangles has 120 edges");
}
