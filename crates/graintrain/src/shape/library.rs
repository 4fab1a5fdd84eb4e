//! Solids in the form of the collision library.

use super::frustum::{Frustum, UPRIGHT};
use crate::hull::Hull;
use crate::math::{Pose, Vec3};
use parry3d_f64::shape::{
    Cuboid, PackedFeatureId, PolygonalFeature, PolygonalFeatureMap, SupportMap, Triangle,
};

/// A solid in the library's form, scaled by 1 / `unit`: the library's tolerances are absolute and made for
/// objects of size about 1.
pub(crate) enum Convex<'a> {
    Box(Cuboid),
    Round(Frustum),
    Triangle(Triangle),
    Hull(ScaledHull<'a>),
}

impl Convex<'_> {
    pub(crate) fn support_map(&self) -> &dyn SupportMap {
        match self {
            Self::Box(cuboid) => cuboid,
            Self::Round(frustum) => frustum,
            Self::Triangle(triangle) => triangle,
            Self::Hull(hull) => hull,
        }
    }

    pub(crate) fn feature_map(&self) -> &dyn PolygonalFeatureMap {
        match self {
            Self::Box(cuboid) => cuboid,
            Self::Round(frustum) => frustum,
            Self::Triangle(triangle) => triangle,
            Self::Hull(hull) => hull,
        }
    }

    /// The arm, over its radius, with which a force along a normal at a point turns what is round about its
    /// axis; zero where it presses on an end, and for all else.
    pub(crate) fn lever(&self, pose: &Pose, point: Vec3, normal: Vec3) -> f64 {
        let (own, along) = (pose.inverse_transform_point(point), pose.rotation.inverse() * normal);
        match self {
            Self::Round(frustum) if along.z.abs() < UPRIGHT => {
                own.cross(along).z.abs() / frustum.largest_radius()
            }
            _ => 0.0,
        }
    }
}

/// A hull with its lengths in units of `unit`.
pub(crate) struct ScaledHull<'a> {
    pub(crate) hull: &'a Hull,
    pub(crate) unit: f64,
}

impl SupportMap for ScaledHull<'_> {
    fn local_support_point(&self, dir: Vec3) -> Vec3 {
        let better = |best: Vec3, next: &Vec3| if next.dot(dir) > best.dot(dir) { *next } else { best };
        self.hull.corners()[1..].iter().fold(self.hull.corners()[0], better) / self.unit
    }
}

impl PolygonalFeatureMap for ScaledHull<'_> {
    /// Of a face with more corners than the library takes, four around it: the others are among the corners
    /// added afterwards.
    fn local_support_feature(&self, dir: Vec3, feature: &mut PolygonalFeature) {
        let faces = self.hull.faces();
        let best = (1..faces.len())
            .fold(0, |best, k| if faces[k].normal.dot(dir) > faces[best].normal.dot(dir) { k } else { best });
        let corners = &faces[best].corners;
        let taken = corners.len().min(feature.vertices.len());
        for k in 0..taken {
            let corner = corners[k * corners.len() / taken];
            feature.vertices[k] = self.hull.corners()[corner as usize] / self.unit;
            feature.vids[k] = PackedFeatureId::vertex(corner);
            feature.eids[k] = PackedFeatureId::edge(corner);
        }
        feature.fid = PackedFeatureId::face(best as u32);
        feature.num_vertices = taken;
    }
}
