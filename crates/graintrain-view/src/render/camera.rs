//! A perspective camera.

use graintrain::math::Vec3;

/// A pinhole camera: a world point p is seen at ( right . (p - eye), up . (p - eye) ) / depth with
/// depth = forward . (p - eye).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Where it is, m.
    pub eye: Vec3,
    /// Unit vector to the right of the picture.
    pub right: Vec3,
    /// Unit vector to the top of the picture.
    pub up: Vec3,
    /// Unit vector into the picture.
    pub forward: Vec3,
    /// Pixels per unit of x / depth.
    pub focal: f64,
    /// The pixel that `forward` goes through: x to the right, y downwards.
    pub center: [f64; 2],
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest coordinates.
    pub low: Vec3,
    /// Largest coordinates.
    pub high: Vec3,
}

impl Bounds {
    /// The empty box.
    pub const EMPTY: Self = Self { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };

    /// Whether it holds no point.
    pub fn is_empty(&self) -> bool {
        self.low.cmpgt(self.high).any()
    }

    /// The smallest box that holds this one and a ball.
    pub fn with(self, center: Vec3, radius: f64) -> Self {
        Self { low: self.low.min(center - radius), high: self.high.max(center + radius) }
    }

    /// The centre.
    pub fn center(&self) -> Vec3 {
        0.5 * (self.low + self.high)
    }

    /// The eight corners.
    pub fn corners(&self) -> [Vec3; 8] {
        std::array::from_fn(|i| {
            let pick = |bit: usize, low: f64, high: f64| if i >> bit & 1 == 0 { low } else { high };
            Vec3::new(
                pick(0, self.low.x, self.high.x),
                pick(1, self.low.y, self.high.y),
                pick(2, self.low.z, self.high.z),
            )
        })
    }
}

impl Camera {
    /// A camera with a field of view of 30 degrees that looks along `forward` and sees every point, as large
    /// as fits into the rectangle of pixels `[left, top, right, bottom]`.
    pub fn fit(points: &[Vec3], forward: Vec3, up: Vec3, [left, top, right, bottom]: [f64; 4]) -> Self {
        let forward = forward.normalize_or(Vec3::NEG_Z);
        let side = forward.cross(up);
        let side = if side.length_squared() > 1e-12 { side } else { forward.any_orthogonal_vector() };
        let right_axis = side.normalize();
        let up = right_axis.cross(forward);
        let half = [0.5 * (right - left).max(2.0), 0.5 * (bottom - top).max(2.0)];
        let focal = half[0].max(half[1]) / 15.0_f64.to_radians().tan();
        let mut bounds = Bounds::EMPTY;
        for &p in points {
            bounds = bounds.with(p, 0.0);
        }
        let target = if bounds.is_empty() { Vec3::ZERO } else { bounds.center() };
        // In camera axes about the target: |x + shift| <= (z + distance) half / focal for every point. The
        // bounds on either side give the smallest distance and the shift that centres the picture.
        let tangent = [half[0] / focal, half[1] / focal];
        let (mut distance, mut shift) = (1e-6_f64, [0.0; 2]);
        for (axis, direction) in [right_axis, up].into_iter().enumerate() {
            let reach = |sign: f64| {
                let of =
                    |p: &Vec3| sign * direction.dot(*p - target) / tangent[axis] - forward.dot(*p - target);
                points.iter().map(of).fold(f64::NEG_INFINITY, f64::max)
            };
            let (plus, minus) = (reach(1.0), reach(-1.0));
            if plus.is_finite() && minus.is_finite() {
                distance = distance.max(0.5 * (plus + minus));
                shift[axis] = 0.5 * (plus - minus) * tangent[axis];
            }
        }
        let eye = target + shift[0] * right_axis + shift[1] * up - distance * forward;
        let center = [0.5 * (left + right), 0.5 * (top + bottom)];
        Self { eye, right: right_axis, up, forward, focal, center }
    }

    /// Direction of the ray through a point of the picture, scaled so that its parameter is the depth.
    pub fn ray(&self, x: f64, y: f64) -> Vec3 {
        self.forward + (x - self.center[0]) / self.focal * self.right
            - (y - self.center[1]) / self.focal * self.up
    }

    /// Coordinates along right, up and forward, relative to the eye.
    pub fn to_camera(&self, point: Vec3) -> Vec3 {
        let d = point - self.eye;
        Vec3::new(self.right.dot(d), self.up.dot(d), self.forward.dot(d))
    }

    /// Where a point is seen; `None` behind the eye.
    pub fn project(&self, point: Vec3) -> Option<[f64; 2]> {
        let p = self.to_camera(point);
        (p.z > 1e-9)
            .then(|| [self.center[0] + self.focal * p.x / p.z, self.center[1] - self.focal * p.y / p.z])
    }

    /// The smallest upright rectangle `[left, top, right, bottom]` that holds the image of a ball, exactly
    /// (the image is an ellipse); `None` where the ball is not entirely in front of the eye.
    pub fn ball_rectangle(&self, center: Vec3, radius: f64) -> Option<[f64; 4]> {
        let c = self.to_camera(center);
        let depth_squared = c.z * c.z - radius * radius;
        if c.z <= radius || depth_squared <= 0.0 {
            return None;
        }
        // Tangents to the circle in the plane of (one axis, depth).
        let range = |a: f64| {
            let root = radius * (a * a + depth_squared).sqrt();
            [(a * c.z - root) / depth_squared, (a * c.z + root) / depth_squared]
        };
        let (x, y) = (range(c.x), range(c.y));
        Some([
            self.center[0] + self.focal * x[0],
            self.center[1] - self.focal * y[1],
            self.center[0] + self.focal * x[1],
            self.center[1] - self.focal * y[0],
        ])
    }
}
