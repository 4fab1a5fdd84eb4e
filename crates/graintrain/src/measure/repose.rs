//! The angle of a slope.

use super::profile::Along;
use super::space::bounds;
use crate::world::World;
use graintrain_linalg::real;

/// Heights between these shares of the way from foot to top make the slope: neither the rounded top nor the
/// run-out at the foot.
const MIDDLE: [f64; 2] = [0.15, 0.85];

/// A slope.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slope {
    /// Its angle, rad; positive where it falls along the coordinate. NaN where there are fewer than three
    /// columns.
    pub angle: f64,
    /// Root mean square deviation of the columns' tops from the line, m.
    pub roughness: f64,
    /// Columns that the line was laid through.
    pub columns: usize,
}

/// The slope of the surface of the bodies that are meant: the straight line through the highest points of
/// columns of this width (m), which lie one beside the other along an axis or radius, between 15 % and 85 %
/// of the way from the lowest to the highest; of an axis the side from the highest column on.
pub fn slope(world: &World, selected: &[bool], along: Along, width: f64) -> Slope {
    let mut tops: std::collections::BTreeMap<i64, f64> = std::collections::BTreeMap::new();
    for (body, place) in world.bodies.position.iter().enumerate().filter(|(body, _)| selected[*body]) {
        let x = match along {
            Along::Axis(axis) => place[axis],
            Along::Radius(centre) => real::hypot(place.x - centre.x, place.y - centre.y),
        };
        let top = tops.entry((x / width).floor() as i64).or_insert(f64::NEG_INFINITY);
        *top = top.max(bounds(world, body)[1].z);
    }
    let highest = tops.values().copied().fold(f64::NEG_INFINITY, f64::max);
    let lowest = tops.values().copied().fold(f64::INFINITY, f64::min);
    let from = tops.iter().find(|(_, top)| **top == highest).map_or(0, |(column, _)| *column);
    let [low, high] = MIDDLE.map(|share| lowest + share * (highest - lowest));
    let points: Vec<[f64; 2]> = tops
        .range(from..)
        .filter(|(_, top)| (low..=high).contains(*top))
        .map(|(column, top)| [(*column as f64 + 0.5) * width, *top])
        .collect();
    let (slope, roughness) = line(&points);
    let angle = if points.len() >= 3 { -real::atan(slope) } else { f64::NAN };
    Slope { angle, roughness, columns: points.len() }
}

/// Slope of the least-squares line and root mean square deviation from it.
fn line(points: &[[f64; 2]]) -> (f64, f64) {
    let n = points.len() as f64;
    let [x, y] = [0, 1].map(|k| points.iter().map(|p| p[k]).sum::<f64>() / n);
    let sums =
        points.iter().fold([0.0; 2], |[xx, xy], p| [xx + (p[0] - x).powi(2), xy + (p[0] - x) * (p[1] - y)]);
    let slope = sums[1] / sums[0];
    let squares: f64 = points.iter().map(|p| (p[1] - y - slope * (p[0] - x)).powi(2)).sum();
    (slope, (squares / n).sqrt())
}

#[cfg(test)]
mod tests {
    use super::super::space::selected;
    use super::*;
    use crate::handle::MaterialId;
    use crate::math::Vec3;
    use crate::shape::Geometry;
    use crate::world::Body;

    /// Balls under a cone and under a roof of known angles.
    #[test]
    fn cones_and_roofs() {
        let mut world = World::default();
        let ball = world.add_geometry(Geometry::sphere(0.05).unwrap());
        let tangent = 25.0_f64.to_radians().tan();
        for i in 0..60 * 60 {
            let (x, y) = (f64::from(i % 60) * 0.1 - 2.95, f64::from(i / 60) * 0.1 - 2.95);
            let height = tangent * (2.5 - x.hypot(y));
            if height > 0.0 {
                world.add_body(Body::new(ball, MaterialId::default(), Vec3::new(x, y, height))).unwrap();
            }
        }
        let all = selected(&world, None, None);
        let found = slope(&world, &all, Along::Radius(Vec3::ZERO), 0.1);
        // The highest ball of a column stands at its inner edge: a shift that the line does not see.
        assert!((found.angle.to_degrees() - 25.0).abs() < 1.0 && found.columns > 10, "{found:?}");
        let along = slope(&world, &all, Along::Axis(0), 0.1);
        assert!((along.angle.to_degrees() - 25.0).abs() < 1.0, "{along:?}");
        assert!(slope(&world, &[false].repeat(all.len()), Along::Axis(0), 0.1).angle.is_nan());
    }
}
