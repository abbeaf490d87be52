//! The frame as shadow volumes take it: a homogeneous light, a camera, triangles.

use antumbra_gpu::{CasterTriangles, Frame, GpuError, SUBPIXEL_STEP, ViewCamera, check_light};
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

/// A camera whose lines of sight meet in an eye.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Perspective {
    /// The camera.
    pub(crate) camera: ViewCamera,
    /// 1, or -1 where the picture is a mirror image.
    pub(crate) handedness: f32,
    /// w of the near plane.
    pub(crate) near: f64,
}

impl Perspective {
    /// By how much the rasteriser may draw an edge aside, metres a metre of w: half of the diagonal of a step of 1/256
    /// pixel where it rounds vertices, all of it where it truncates them. The latter is taken.
    pub(crate) fn aside(&self, size: (u32, u32)) -> f64 {
        let rows = self.camera.clip.transpose();
        // w metres off, a pixel is 2 w / (pixels |row|) wide.
        let pixel = |row: DVec4, pixels: u32| 2.0 / (f64::from(pixels) * row.truncate().length());
        let [x, y] = [pixel(rows.x_axis, size.0), pixel(rows.y_axis, size.1)];
        x.hypot(y) * f64::from(SUBPIXEL_STEP)
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
/// A frame without a camera, or with an orthographic one.
pub(crate) fn perspective(frame: &Frame<'_>) -> Result<Perspective, GpuError> {
    let invalid = |value: String, fix| GpuError::Invalid { what: "camera", value, fix };
    let without_camera = "give the frame its camera, or use `volume/triangle`, which needs none";
    let camera = frame.camera.ok_or_else(|| invalid("none".to_owned(), without_camera))?;
    let rows = camera.clip.transpose();
    // The corners of a triangle run counter-clockwise in the picture if det (h0, h1, h2) of h = (x, y, w) is
    // positive. With the eye at e, h = A (p - e): the sign is that of det A times det (p0 - e, p1 - e, p2 - e), which is
    // negative where they run counter-clockwise as seen from e.
    let [x, y, w] = [rows.x_axis, rows.y_axis, rows.w_axis];
    let det = DMat3::from_cols(x.truncate(), y.truncate(), w.truncate()).determinant();
    // An orthographic camera has no perspective row; far caps are then no faces but points of view at infinity.
    if !(det.is_finite() && det != 0.0 && w.truncate() != DVec3::ZERO) {
        let fix = "use a perspective camera, or `volume/triangle`, which needs none";
        return Err(invalid(format!("{}", camera.clip), fix));
    }
    Ok(Perspective { camera, handedness: if det < 0.0 { 1.0 } else { -1.0 }, near: near(&camera) })
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
