//! Where expected values come from: literature in full, or algebra.

use std::fmt;

/// Where an expected value comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Follows in a line or two; which lines.
    Algebra(&'static str),
    /// Published.
    Published {
        /// All authors.
        authors: &'static str,
        /// Title of the article or book.
        title: &'static str,
        /// Journal with volume and pages, or publisher and edition.
        journal: &'static str,
        /// Year of publication.
        year: u16,
    },
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Algebra(how) => write!(f, "algebra: {how}"),
            Self::Published { authors, title, journal, year } => {
                write!(f, "{authors}, \u{201c}{title}\u{201d}, {journal}, {year}")
            }
        }
    }
}

macro_rules! published {
    ($($(#[$doc:meta])* $name:ident: $authors:literal, $title:literal, $journal:literal, $year:literal;)*) => {
        $($(#[$doc])* pub const $name: Source =
            Source::Published { authors: $authors, title: $title, journal: $journal, year: $year };)*
    };
}

published! {
    /// The relaxed contact model.
    RELAXED: "M. Anitescu, A. Tasora",
        "An iterative approach for cone complementarity problems for nonsmooth dynamics",
        "Computational Optimization and Applications 47, 207-235", 2010;
    /// Tangential restitution of an alumina sphere.
    CHUNG_OOI: "Y. C. Chung, J. Y. Ooi",
        "Benchmark tests for verifying discrete element modelling codes at particle impact level",
        "Granular Matter 13, 643-656", 2011;
    /// The paradox of the sliding rod.
    PAINLEVE: "P. Painleve",
        "Sur les lois du frottement de glissement",
        "Comptes rendus de l'Academie des sciences 121, 112-115", 1895;
    /// Where the paradox begins.
    GENOT_BROGLIATO: "F. Genot, B. Brogliato",
        "New results on Painleve paradoxes",
        "European Journal of Mechanics A/Solids 18, 653-677", 1999;
    /// Torque-free rotation by elliptic integrals.
    LANDAU: "L. D. Landau, E. M. Lifshitz",
        "Mechanics",
        "Butterworth-Heinemann, 3rd edition, section 37", 1976;
    /// The heavy top.
    GOLDSTEIN: "H. Goldstein, C. Poole, J. Safko",
        "Classical Mechanics",
        "Addison-Wesley, 3rd edition, section 5.7", 2002;
    /// Cost of indeterminate contact forces.
    OLSEN_KAMRIN: "T. Olsen, K. Kamrin",
        "Resolving force indeterminacy in contact dynamics using compatibility conditions",
        "arXiv 1805.07437", 2018;
    /// Simultaneous plastic impact and frictional dynamics.
    MOREAU: "J. J. Moreau",
        "Unilateral contact and dry friction in finite freedom dynamics",
        "Nonsmooth Mechanics and Applications, CISM Courses and Lectures 302, 1-82", 1988;
    /// Friction angle of spheres without friction.
    PEYNEAU_ROUX: "P.-E. Peyneau, J.-N. Roux",
        "Frictionless bead packs have macroscopic friction, but no dilatancy",
        "Physical Review E 78, 011307", 2008;
    /// Friction of assemblies in the critical state.
    CHIALVO: "S. Chialvo, J. Sun, S. Sundaresan",
        "Bridging the rheology of granular flows in three regimes",
        "Physical Review E 85, 021305", 2012;
    /// Passive earth pressure.
    RANKINE: "W. J. M. Rankine",
        "On the stability of loose earth",
        "Philosophical Transactions of the Royal Society of London 147, 9-27", 1857;
    /// Isotropic packings with and without friction.
    AGNOLIN_ROUX: "I. Agnolin, J.-N. Roux",
        "Internal states of model isotropic granular packings. I. Assembling process, geometry, and contact networks",
        "Physical Review E 76, 061302", 2007;
    /// Density and contacts from random close to random loose packing.
    SILBERT: "L. E. Silbert",
        "Jamming of frictional spheres and random loose packing",
        "Soft Matter 6, 2918-2924", 2010;
    /// Density by the number of contacts, mean field.
    SONG_WANG_MAKSE: "C. Song, P. Wang, H. A. Makse",
        "A phase diagram for jammed matter",
        "Nature 453, 629-632", 2008;
    /// Pressure in silos.
    JANSSEN: "H. A. Janssen",
        "Versuche ueber Getreidedruck in Silozellen",
        "Zeitschrift des Vereines Deutscher Ingenieure 39, 1045-1049", 1895;
    /// Silo pressure in simulations of spheres.
    LANDRY: "J. W. Landry, G. S. Grest, L. E. Silbert, S. J. Plimpton",
        "Confined granular packings: structure, stress, and forces",
        "Physical Review E 67, 041303", 2003;
    /// Discharge through an orifice.
    BEVERLOO: "W. A. Beverloo, H. A. Leniger, J. van de Velde",
        "The flow of granular solids through orifices",
        "Chemical Engineering Science 15, 260-269", 1961;
    /// Angle of repose of spheres.
    ZHOU: "Y. C. Zhou, B. H. Xu, A. B. Yu, P. Zulli",
        "Numerical investigation of the angle of repose of monosized spheres",
        "Physical Review E 64, 021301", 2001;
    /// Regimes of the rotating drum.
    MELLMANN: "J. Mellmann",
        "The transverse motion of solids in rotating cylinders: forms of motion and transition behavior",
        "Powder Technology 118, 251-270", 2001;
}
