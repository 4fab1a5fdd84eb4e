//! Handles: typed indices of the things of a world, which cannot be taken for each other.
//!
//! Arguments that change places do not compile:
//!
//! ```compile_fail,E0308
//! use graintrain::material::Materials;
//! use graintrain::math::Vec3;
//! use graintrain::shape::Geometry;
//! use graintrain::world::{Body, World};
//!
//! let mut world = World::default();
//! let ball = world.add_geometry(Geometry::sphere(0.05).unwrap());
//! let steel = world.materials.add("steel", 7800.0).unwrap();
//! world.add_body(Body::new(steel, ball, Vec3::ZERO)).unwrap();
//! ```
//!
//! and in their places they do:
//!
//! ```
//! # use graintrain::math::Vec3;
//! # use graintrain::shape::Geometry;
//! # use graintrain::world::{Body, World};
//! # let mut world = World::default();
//! # let ball = world.add_geometry(Geometry::sphere(0.05).unwrap());
//! # let steel = world.materials.add("steel", 7800.0).unwrap();
//! let body = world.add_body(Body::new(ball, steel, Vec3::ZERO)).unwrap();
//! assert_eq!(world.bodies.position[body.index()], Vec3::ZERO);
//! ```

use serde::{Deserialize, Serialize};

macro_rules! handle {
    ($(#[$about:meta])* $name:ident) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        #[serde(transparent)]
        pub struct $name(u32);

        impl $name {
            /// The handle of what stands at this index of its list. Whether there is such a thing is checked
            /// where the handle is used.
            pub const fn from_index(index: usize) -> Self {
                // No list is as long as u32::MAX: that one is refused like any other that does not exist.
                Self(if index < u32::MAX as usize { index as u32 } else { u32::MAX })
            }

            /// Index in its list.
            pub const fn index(self) -> usize {
                self.0 as usize
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                self.0.fmt(f)
            }
        }
    };
}

handle! {
    /// A geometry of [`World::geometries`](crate::world::World::geometries).
    GeometryId
}
handle! {
    /// A material of [`Materials`](crate::material::Materials); the first one by default.
    #[derive(Default)]
    MaterialId
}
handle! {
    /// A motion of [`World::motions`](crate::world::World::motions), or [`FREE`](crate::world::FREE), the
    /// default.
    MotionId
}
handle! {
    /// A body of [`Bodies`](crate::world::Bodies); the first one by default. Removal of bodies gives others
    /// new handles: [`World::remove_bodies`](crate::world::World::remove_bodies) returns them.
    #[derive(Default)]
    BodyId
}

handle! {
    /// A joint of a world, see [`World::add_joint`](crate::world::World::add_joint).
    JointId
}

impl Default for MotionId {
    fn default() -> Self {
        crate::world::FREE
    }
}
