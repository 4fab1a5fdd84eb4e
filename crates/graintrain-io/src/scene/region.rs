//! Regions: boxes and upright cylinders.

use super::error::SceneError;
use super::reader::Reader;
use super::table::{Field, table};
use graintrain::load::Region;
use graintrain::math::Vec3;

table! {
    pub(super) static REGION: "`region`", at most one of ["box", "cylinder"] {
        /// Box
        box = Table(&BOX_REGION), "one of box, cylinder", "{ min = [0, 0, 0], max = [1, 1, 3] }";
        /// Upright cylinder
        cylinder = Table(&CYLINDER_REGION), "one of box, cylinder", "{ radius = 1, height = 3 }";
    }
}

table! {
    pub(super) static BOX_REGION: "`box` of a region" {
        /// Lower corner; dropped bodies are completely inside
        min = Vector(D::LENGTH), "required", "[0, 0, 0]";
        /// Upper corner
        max = Vector(D::LENGTH), "required", "[1, 1, 3]";
    }
}

table! {
    pub(super) static CYLINDER_REGION: "`cylinder` of a region" {
        /// Centre of the lower end
        base = Vector(D::LENGTH), "[0, 0, 0]", "[0, 0, \"1 cm\"]";
        /// Radius; dropped bodies are completely inside
        radius = Quantity(D::LENGTH), "required", "\"10 cm\"", Positive;
        /// Height, along z
        height = Quantity(D::LENGTH), "required", "\"30 cm\"", Positive;
    }
}

impl Field for Region {
    fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        reader.child(key)?.as_ref().map(region).transpose()
    }
}

/// The region that a table names: a box or a cylinder.
pub(super) fn region(reader: &Reader) -> Result<Region, SceneError> {
    let (form, inner) = reader.form()?;
    Ok(if form == "box" {
        let (min, max) = (inner.field::<Vec3>("min")?, inner.field("max")?);
        if !min.cmplt(max).all() {
            return Err(inner.out_of_range("max", &format!("above min ({min}) along every axis"), max));
        }
        Region::Box { min, max }
    } else {
        Region::Cylinder {
            base: inner.field("base")?,
            radius: inner.field("radius")?,
            height: inner.field("height")?,
        }
    })
}
