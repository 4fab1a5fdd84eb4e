//! Kinematic pairs: what a joint holds of a place on A and a place on B, each a point with axes t1, t2, a. A
//! new pair is a line of `pairs!`.
//!
//! Source: F. Reuleaux, "The Kinematics of Machinery", Macmillan, 1876; the rows: P. E. Nikravesh,
//! "Computer-Aided Analysis of Mechanical Systems", Prentice Hall, 1988.

use super::Coordinate::{self, Slide, Turn};
use serde::{Deserialize, Serialize};

/// Axes t1, t2, a of a place.
const T1: usize = 0;
const T2: usize = 1;
const AXIS: usize = 2;

/// Rows that keep the axis of B along that of A.
const ALIGNED: &[[usize; 2]] = &[[AXIS, T1], [AXIS, T2]];

/// Rows that keep all axes of B along those of A.
const ORIENTED: &[[usize; 2]] = &[[AXIS, T1], [AXIS, T2], [T1, T2]];

macro_rules! pairs {
    ($($(#[$doc:meta])* $name:ident = $text:literal, $along:expr, $square:expr, $coordinates:expr;)+) => {
        /// A joint between two places, one point with axes in the world where it is added.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        pub enum Pair {
            $($(#[$doc])* $name,)+
        }

        impl Pair {
            /// Every pair.
            pub const ALL: &'static [Self] = &[$(Self::$name,)+];

            /// What scenes and messages call it.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$name => $text,)+
                }
            }

            /// Axes of A along which the point of B stays at that of A.
            pub(super) fn held_along(self) -> &'static [usize] {
                match self {
                    $(Self::$name => $along,)+
                }
            }

            /// Pairs of an axis of B and one of A that stay at right angles.
            pub(super) fn held_square(self) -> &'static [[usize; 2]] {
                match self {
                    $(Self::$name => $square,)+
                }
            }

            /// What motors, springs and stops can act on, the default first.
            pub fn coordinates(self) -> &'static [Coordinate] {
                match self {
                    $(Self::$name => $coordinates,)+
                }
            }
        }
    };
}

// Checkpoints count the variants: new ones come last.
pairs! {
    /// Both bodies move as one; the point is where reactions are reported.
    Fixed = "fixed", &[T1, T2, AXIS], ORIENTED, &[];
    /// A hinge about the axis.
    Revolute = "revolute", &[T1, T2, AXIS], ALIGNED, &[Turn];
    /// A slide along the axis that cannot turn.
    Prismatic = "prismatic", &[T1, T2], ORIENTED, &[Slide];
    /// A shaft that slides along the axis and turns about it.
    Cylindrical = "cylindrical", &[T1, T2], ALIGNED, &[Turn, Slide];
    /// A ball in a socket.
    Spherical = "spherical", &[T1, T2, AXIS], &[], &[];
    /// A puck on a table: it slides across the axis both ways and turns about it.
    Planar = "planar", &[AXIS], ALIGNED, &[Turn];
}

impl Pair {
    /// Whether it matters where its axis leads: not where it holds all directions alike, or none.
    pub fn has_axis(self) -> bool {
        !([0, 3].contains(&self.held_along().len()) && [0, 3].contains(&self.held_square().len()))
    }

    /// The coordinate that motors, springs and stops act on where this one is wished for; `None` where there
    /// is none.
    pub fn coordinate(self, wished: Coordinate) -> Option<Coordinate> {
        let own = self.coordinates();
        if own.contains(&wished) { Some(wished) } else { own.first().copied() }
    }
}
