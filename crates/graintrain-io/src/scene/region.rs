//! Regions: boxes and upright cylinders.

use super::error::SceneError;
use super::reader::Reader;
use super::table::{Field, Spec, table};
use graintrain::load::Region;
use graintrain::math::Vec3;

table! {
    /// A region, as a scene has it.
    pub(super) enum RegionSpec: "`region`" {
        /// Box
        Box(BoxRegion): box = Table(BoxRegion::TABLE), "{ min = [0, 0, 0], max = [1, 1, 3] }";
        /// Upright cylinder
        Cylinder(CylinderRegion): cylinder = Table(CylinderRegion::TABLE), "{ radius = 1, height = 3 }";
    }
}

table! {
    /// A box.
    pub(super) struct BoxRegion: "`box` of a region", checked by is_box {
        /// Lower corner; dropped bodies are completely inside
        min: Vec3 = Vector(D::LENGTH), "required", "[0, 0, 0]";
        /// Upper corner
        max: Vec3 = Vector(D::LENGTH), "required", "[1, 1, 3]";
    }
}

table! {
    /// An upright cylinder.
    pub(super) struct CylinderRegion: "`cylinder` of a region" {
        /// Centre of the lower end
        base: Vec3 = Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, \"1 cm\"]";
        /// Radius; dropped bodies are completely inside
        radius: f64 = Quantity(D::LENGTH), "required", "\"10 cm\"", Positive;
        /// Height, along z
        height: f64 = Quantity(D::LENGTH), "required", "\"30 cm\"", Positive;
    }
}

fn is_box(&BoxRegion { min, max }: &BoxRegion, reader: &Reader) -> Result<(), SceneError> {
    if min.cmplt(max).all() {
        return Ok(());
    }
    Err(reader.out_of_range("max", &format!("above min ({min}) along every axis"), max))
}

impl Field for Region {
    fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        reader.child(key)?.as_ref().map(region).transpose()
    }
}

/// The region that a table names: a box or a cylinder.
pub(super) fn region(reader: &Reader) -> Result<Region, SceneError> {
    Ok(match RegionSpec::read(reader)? {
        RegionSpec::Box(BoxRegion { min, max }) => Region::Box { min, max },
        RegionSpec::Cylinder(CylinderRegion { base, radius, height }) => {
            Region::Cylinder { base, radius, height }
        }
    })
}
