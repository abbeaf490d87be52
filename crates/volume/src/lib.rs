//! Geometric shadow volumes: exact hard shadows for any mesh, without a shadow map (Crow 1977).
//!
//! A point is in shadow if it lies in the *shadow volume* of some triangle: the part of space behind the
//! triangle as the light sees it. Whether a view sample does is found by counting the volumes' faces along
//! a line from it (Heidmann 1991).
