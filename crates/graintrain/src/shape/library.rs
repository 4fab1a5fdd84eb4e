//! Solids in the form of the collision library.

use super::frustum::Frustum;
use crate::hull::Hull;
use crate::math::Vec3;
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
