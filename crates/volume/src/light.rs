//! The frame as shadow volumes take it: a homogeneous light, a camera, triangles.

use antumbra_gpu::{CasterEdges, CasterTriangles, Frame, Gpu, GpuError, ViewCamera, check_light};
use glam::{DMat3, DMat4, DVec2, DVec3, DVec4, Vec4};

/// The light as a homogeneous point relative to the frame's origin: (position, 1), or (unit direction towards it, 0).
/// Area lights are treated as their centre.
#[must_use]
pub fn homogeneous_light(frame: &Frame<'_>) -> Vec4 {
    let light = match frame.light.position() {
        Some(position) => (position - frame.origin).extend(1.0),
        None => frame.light.towards(DVec3::ZERO, DVec2::splat(0.5)).extend(0.0),
    };
    light.as_vec4()
}

/// Height above a sample, metres, up to which what covers it touches it and does not shadow it: 32u of the largest
/// coordinate of the casters, u = 2^-24, which is 2e-6 of a scene around its origin. Samples near a crease may lie behind the
/// face beyond it, since rasterisers draw surfaces aside; and where positions are known to some u, nothing that is
/// nearer can be told from the surface itself. Rays of the ray-traced truth begin at this height.
pub(crate) fn contact(frame: &Frame<'_>) -> f32 {
    let mut extent = 0.0_f64;
    frame.casters.hull(frame.light, &mut |p| {
        extent = extent.max((p - frame.origin).abs().max_element());
    });
    (extent * 32.0 * (-24.0_f64).exp2()) as f32
}

/// The casters' triangles.
///
/// # Errors
/// Casters that keep them to themselves, or an unusable light.
pub(crate) fn triangles<'a>(frame: &Frame<'a>) -> Result<CasterTriangles<'a>, GpuError> {
    check_light(frame.light)?;
    frame.casters.triangles().ok_or_else(|| GpuError::Invalid {
        what: "casters",
        value: "without triangles".to_owned(),
        fix: "implement `Casters::triangles`, or use a technique over a depth map",
    })
}

/// The edges of the casters.
///
/// # Errors
/// Casters that keep them to themselves: `fix` says what to do.
pub(crate) fn edges<'a>(
    gpu: &Gpu,
    frame: &Frame<'a>,
    fix: &'static str,
) -> Result<&'a CasterEdges, GpuError> {
    let (what, value) = ("casters", "without edges".to_owned());
    frame.casters.edges(gpu)?.ok_or(GpuError::Invalid { what, value, fix })
}

/// A camera, and where its lines of sight come from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Viewer {
    /// The camera.
    pub(crate) camera: ViewCamera,
    /// The eye relative to the frame's origin and 1, or the unit direction to where parallel lines of sight come from
    /// and 0.
    pub(crate) eye: DVec4,
    /// w of the near plane; 0 where lines of sight are parallel.
    pub(crate) near: f64,
}

impl Viewer {
    /// What clip space makes of the way from the eye, and of the eye itself: rows of x, y and w.
    pub(crate) fn rows(&self) -> [[f32; 4]; 3] {
        let rows = self.camera.clip.transpose();
        // Where lines meet in the eye, that is nowhere in the picture.
        let parallel = self.eye.w == 0.0;
        let at = |row: DVec4| if parallel { row.dot(self.camera.eye.extend(1.0)) } else { 0.0 };
        [rows.x_axis, rows.y_axis, rows.w_axis]
            .map(|row| row.truncate().extend(at(row)).as_vec4().to_array())
    }

    /// Points to clip space by way of the camera's near plane, onto which the light casts them: the first stage of
    /// ZP+ (Hornus, Hoberock, Lefebvre and Hart 2005), in homogeneous form for both kinds of light.
    ///
    /// With pi the near plane, pi . P = w - near, the line from the light L through P meets it at
    /// (pi . L) P - (pi . P) L. Its sign is made so that w > 0 for points that the light is in front of, and
    /// z >= 0 where P lies before the plane as the light comes. z needs only its sign, and is kept so far below w
    /// that the end of the depth range cuts off nothing but a 2^-40 of the way at the light.
    pub(crate) fn cast(&self, light: DVec4) -> DMat4 {
        let clip = self.camera.clip;
        let rows = clip.transpose();
        let plane = rows.w_axis - DVec4::new(0.0, 0.0, 0.0, self.near);
        let reach = plane.dot(light);
        let outer =
            DMat4::from_cols(light * plane.x, light * plane.y, light * plane.z, light * plane.w);
        let side = if reach < 0.0 { -1.0 } else { 1.0 };
        let cast = clip * (DMat4::from_diagonal(DVec4::splat(reach)) - outer) * side;
        let mut rows = cast.transpose();
        rows.z_axis = plane * (side * self.near * (-40.0_f64).exp2());
        rows.transpose()
    }
}

/// The frame's camera.
///
/// # Errors
/// A frame without a camera, or with one that shows nothing.
pub(crate) fn viewer(frame: &Frame<'_>) -> Result<Viewer, GpuError> {
    let invalid = |value: String, fix| GpuError::Invalid { what: "camera", value, fix };
    let without_camera = "give the frame its camera, or use `volume/triangle`, which needs none";
    let camera = frame.camera.ok_or_else(|| invalid("none".to_owned(), without_camera))?;
    let rows = camera.clip.transpose();
    let [x, y, w] = [rows.x_axis, rows.y_axis, rows.w_axis].map(DVec4::truncate);
    let fix = "give an invertible matrix and the eye before it, or use `volume/triangle`, which needs none";
    let eye = camera.homogeneous_eye();
    let (third, near) = if eye.w == 0.0 { (eye.truncate(), 0.0) } else { (w, near(&camera)) };
    let det = DMat3::from_cols(x, y, third).determinant();
    if !(det.is_finite() && det != 0.0 && camera.eye.is_finite()) {
        return Err(invalid(format!("{}", camera.clip), fix));
    }
    Ok(Viewer { camera, eye, near })
}

/// w of the plane of depth 0 or 1 that is nearer to the eye, in the middle of the picture.
fn near(camera: &ViewCamera) -> f64 {
    let inverse = camera.clip.inverse();
    [0.0, 1.0]
        .map(|depth| inverse * DVec4::new(0.0, 0.0, depth, 1.0))
        .into_iter()
        .filter(|p| p.w != 0.0)
        .map(|p| (camera.clip * (p / p.w)).w)
        .filter(|w| w.is_finite() && *w > 0.0)
        .fold(f64::INFINITY, f64::min)
}
