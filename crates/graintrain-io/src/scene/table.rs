//! Tables of scenes, each declared once: [`table!`] makes of one declaration the struct of the resolved
//! scene, the keys of the schema (with those the documentation and the JSON Schema) and the function that
//! reads it.

use super::error::SceneError;
use super::reader::Reader;
use super::schema::{Kind, Table};
use graintrain::math::Vec3;

/// A value that a key can have.
pub(crate) trait Field: Sized {
    /// The texts that the key may hold; empty where any will do.
    fn choices() -> Vec<&'static str> {
        Vec::new()
    }

    /// The value, if the key is given.
    fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError>;
}

/// What [`table!`] makes of a table.
pub(crate) trait Spec: Sized {
    /// The keys.
    const TABLE: &'static Table;

    /// Reads the table.
    fn read(reader: &Reader) -> Result<Self, SceneError>;
}

/// One of a few words.
pub(crate) trait Choice: Copy + 'static {
    /// Every word and what it stands for.
    const NAMES: &'static [(&'static str, Self)];
}

/// A key that need not be given, and has no value then.
impl<T: Field> Field for Option<T> {
    fn choices() -> Vec<&'static str> {
        T::choices()
    }

    fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        if reader.get(key).is_none() { Ok(Some(None)) } else { T::given(reader, key).map(Some) }
    }
}

impl<T: Choice> Field for T {
    fn choices() -> Vec<&'static str> {
        T::NAMES.iter().map(|(name, _)| *name).collect()
    }

    fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        reader.choice(key, T::NAMES)
    }
}

impl Field for Vec3 {
    fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        match reader.kind(key) {
            Kind::Direction => reader.direction(key),
            Kind::VectorOrQuantity(_) => reader.vector_or_quantity(key),
            _ => reader.vector(key),
        }
    }
}

/// Values that a method of [`Reader`] reads.
macro_rules! fields {
    ($($type:ty: $method:ident,)+) => {
        $(impl Field for $type {
            fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
                reader.$method(key)
            }
        })+
    };
}

fields! {
    f64: quantity,
    Vec<f64>: list,
    u64: count,
    [u64; 3]: counts,
    bool: flag,
    String: text,
    std::path::PathBuf: path,
    super::model::FunctionSpec: function,
    [super::model::FunctionSpec; 3]: functions,
    graintrain::material::TurningResistance: resistance,
}

impl Field for usize {
    fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        Ok(reader.count(key)?.map(|count| count as usize))
    }
}

/// Without the key a list is empty.
impl Field for Vec<String> {
    fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        Ok(Some(reader.texts(key)?.unwrap_or_default()))
    }
}

/// Tables with names of the user's choice.
impl<T: Spec> Field for Vec<(String, T)> {
    fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        let tables = reader.named(key)?.into_iter().map(|(name, inner)| Ok((name, T::read(&inner)?)));
        tables.collect::<Result<_, _>>().map(Some)
    }
}

/// A list of tables.
impl<T: Spec> Field for Vec<T> {
    fn given(reader: &Reader, key: &str) -> Result<Option<Self>, SceneError> {
        reader.tables(key)?.iter().map(T::read).collect::<Result<_, _>>().map(Some)
    }
}

/// Declares a table of scenes. As a struct of the resolved scene:
///
/// ```text
/// table! {
///     /// A spring and damper for a displacement or distance.
///     pub struct SpringSpec: "`spring`", checked by is_spring {
///         /// Force per length
///         stiffness: f64 = Quantity(STIFFNESS), "0", "\"10 kN/m\"", NotNegative;
///         /// Displacement or distance without force, a function of time
///         rest: Option<FunctionSpec> = Function(D::LENGTH, &LENGTH), "its value at time 0", "\"20 cm\"";
///         location
///     }
/// }
/// ```
///
/// After its name a table has its heading in the documentation, then perhaps groups of keys that exclude each
/// other (`, at most one of ["rate", "mass_rate"]`) and a function that looks at what was read, for what
/// concerns several keys (`, checked by FUNCTION`, a `fn(&SpringSpec, &Reader) -> Result<(), SceneError>`).
///
/// A row has
/// - the meaning of the key, as the documentation tells it,
/// - perhaps `#[serde(...)]`: how it is written; `None` never is,
/// - its name and type, a [`Field`] unless a function reads it, which also says what texts it may hold,
/// - what it holds, a [`Kind`](super::schema::Kind),
/// - its default: a value in TOML, perhaps with an explanation after a colon, or `required`; or a sentence,
///   where the type is an `Option` or a list, or a function reads the key,
/// - an example in TOML,
/// - perhaps the [`Range`](super::schema::Range) of its numbers,
/// - perhaps the function that reads it, `=> FUNCTION`, a `fn(&Reader, &str) -> Result<TYPE, SceneError>`.
///
/// `location` at the end stands for a field with the place where the table is written, `location of KEY, KEY`
/// for that of the first of these keys that is given.
///
/// A table without a struct of its own, read by hand or by that of another one with the same keys, is a
/// `static` whose rows have no type; the texts that a key may hold are given behind its example:
///
/// ```text
/// table! {
///     static RADIUS: "`packing.NAME.radius`" {
///         /// Whether fractions are by number of spheres, or by mass
///         by = Text, "\"number\"", "\"mass\"" in BY;
///     }
/// }
/// ```
macro_rules! table {
    (@range) => { $crate::scene::schema::Range::Any };
    (@range $range:ident) => { $crate::scene::schema::Range::$range };
    (@choices) => { Vec::new };
    (@choices $choices:path) => { || $crate::scene::schema::names($choices) };
    (@choices_of $type:ty => $read:path) => { Vec::new };
    (@choices_of $type:ty) => { <$type as $crate::scene::table::Field>::choices };
    (@choices_of $type:ty, $choices:path $(=> $read:path)?) => { table!(@choices $choices) };
    (@value $reader:ident, $key:expr) => { $reader.field($key)? };
    (@value $reader:ident, $key:expr, $read:path) => { $read($reader, $key)? };
    (
        $(#[$attribute:meta])*
        pub struct $name:ident: $heading:literal
        $(, at most one of [$($alternative:literal),+])* $(, checked by $check:path)? {
            $(
                $(#[doc = $about:literal])+
                $(#[serde($($serde:tt)+)])?
                $field:ident: $type:ty = $kind:expr, $default:literal, $example:literal $(in $choices:path)?
                $(, $range:ident)? $(=> $read:path)?;
            )+
            $($location:ident $(of $($place:ident),+)?)?
        }
    ) => {
        $(#[$attribute])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize)]
        pub struct $name {
            $(
                $(#[doc = $about])+
                #[doc = concat!("\n\n`", stringify!($kind), "`, default: ", $default)]
                $(#[serde($($serde)+)])?
                pub $field: $type,
            )+
            $(
                /// Where it is written.
                #[serde(skip)]
                pub $location: $crate::scene::error::Location,
            )?
        }

        impl $crate::scene::table::Spec for $name {
            const TABLE: &'static $crate::scene::schema::Table = {
                #[allow(unused_imports)]
                use $crate::scene::schema::{D, Kind::*, function::*};
                static TABLE: $crate::scene::schema::Table = $crate::scene::schema::Table {
                    heading: $heading,
                    alternatives: &[$(&[$($alternative),+]),*],
                    keys: &[$($crate::scene::schema::Key {
                        name: stringify!($field),
                        kind: $kind,
                        range: table!(@range $($range)?),
                        choices: table!(@choices_of $type $(, $choices)? $(=> $read)?),
                        default: $default,
                        example: $example,
                        about: concat!($($about),+).trim_ascii_start(),
                    }),+],
                };
                &TABLE
            };

            fn read(
                reader: &$crate::scene::reader::Reader,
            ) -> Result<Self, $crate::scene::error::SceneError> {
                reader.check_alternatives()?;
                let spec = Self {
                    $($field: table!(@value reader, stringify!($field) $(, $read)?),)+
                    $($location: reader.location_of(&[$($(stringify!($place)),+)?]).clone(),)?
                };
                $($check(&spec, reader)?;)?
                Ok(spec)
            }
        }

        impl $crate::scene::table::Field for $name {
            fn given(
                reader: &$crate::scene::reader::Reader,
                key: &str,
            ) -> Result<Option<Self>, $crate::scene::error::SceneError> {
                reader.child(key)?.as_ref().map($crate::scene::table::Spec::read).transpose()
            }
        }
    };
    (
        $(#[$attribute:meta])*
        $visibility:vis static $name:ident: $heading:literal
        $(, at most one of [$($alternative:literal),+])* {
            $(
                $(#[doc = $about:literal])+
                $key:ident = $kind:expr, $default:literal, $example:literal $(in $choices:path)?
                $(, $range:ident)?;
            )+
        }
    ) => {
        $(#[$attribute])*
        $visibility static $name: $crate::scene::schema::Table = {
            #[allow(unused_imports)]
            use $crate::scene::schema::{D, Kind::*, function::*};
            $crate::scene::schema::Table {
                heading: $heading,
                alternatives: &[$(&[$($alternative),+]),*],
                keys: &[$($crate::scene::schema::Key {
                    name: stringify!($key),
                    kind: $kind,
                    range: table!(@range $($range)?),
                    choices: table!(@choices $($choices)?),
                    default: $default,
                    example: $example,
                    about: concat!($($about),+).trim_ascii_start(),
                }),+],
            }
        };
    };
}
pub(crate) use table;
