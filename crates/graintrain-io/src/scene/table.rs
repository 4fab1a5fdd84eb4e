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
/// A row without a type is a key alone, which the function of a field reads: of the number of steps `end`. A
/// row without what it holds, `source: PackingSource => Spec::read;`, is a field alone, read from the whole
/// table by a `fn(&Reader) -> Result<TYPE, SceneError>`. `keys of TABLE;` stands for the rows of another
/// table.
///
/// `location` at the end stands for a field with the place where the table is written, `location of KEY, KEY`
/// for that of the first of these keys that is given.
///
/// A table of which exactly one key is given is an `enum`; its rows have no default:
///
/// ```text
/// table! {
///     /// A way out.
///     pub enum OutletSpec: "`[outlet.NAME]`" {
///         /// They leave when it is outside the region
///         Outside(Region): outside = Table(RegionSpec::TABLE), "{ box = { min = [-1, -1, -1], max = [1, 1, 1] } }";
///     }
/// }
/// ```
///
/// A table without a struct of its own, read by hand or by that of another one with the same keys, is a
/// `static` whose rows have no type; the texts that a key may hold are given behind its example:
///
/// ```text
/// table! {
///     static FUNCTION: "Function of time" {
///         /// A table of instants and values
///         file = Text, "required", "\"speed.csv\"";
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
    (@value $reader:ident $field:ident (key)) => { $reader.field(stringify!($field))? };
    (@value $reader:ident $field:ident (key $read:path)) => { $read($reader, stringify!($field))? };
    (@value $reader:ident $field:ident (keys $read:path)) => { $read($reader)? };
    (@value $reader:ident $field:ident (place $($key:ident)*)) => {
        $reader.location_of(&[$(stringify!($key)),*]).clone()
    };
    (@key $name:ident, $kind:expr, $default:expr, $example:expr, $about:expr, [$($range:ident)?], $choices:expr) => {
        $crate::scene::schema::Key {
            name: stringify!($name),
            kind: $kind,
            range: table!(@range $($range)?),
            choices: $choices,
            default: $default,
            example: $example,
            about: $about.trim_ascii_start(),
        }
    };
    (@table $heading:tt, [$($alternatives:tt)*], $($keys:expr,)+) => {{
        #[allow(unused_imports)]
        use $crate::scene::schema::{D, Kind::*, function::*};
        const KEYS: &[&[$crate::scene::schema::Key]] = &[$($keys),+];
        $crate::scene::schema::Table {
            heading: $heading,
            alternatives: &[$(&$alternatives),*],
            keys: &$crate::scene::schema::joined::<{ $crate::scene::schema::count(KEYS) }>(KEYS),
        }
    }};
    // A row of a key that is a field.
    (@rows $head:tt [$($fields:tt)*] [$($keys:tt)*] [$($values:tt)*]
        $(#[doc = $about:literal])+
        $(#[serde($($serde:tt)+)])?
        $field:ident: $type:ty = $kind:expr, $default:literal, $example:literal $(in $choices:path)?
        $(, $range:ident)? $(=> $read:path)?;
        $($rows:tt)*
    ) => {
        table! {
            @rows $head
            [$($fields)*
                $(#[doc = $about])+
                #[doc = concat!("\n\n`", stringify!($kind), "`, default: ", $default)]
                $(#[serde($($serde)+)])?
                pub $field: $type,
            ]
            [$($keys)* &[table!(@key $field, $kind, $default, $example, concat!($($about),+), [$($range)?],
                table!(@choices_of $type $(, $choices)? $(=> $read)?))],]
            [$($values)* $field (key $($read)?)]
            $($rows)*
        }
    };
    // A row of a key alone.
    (@rows $head:tt $fields:tt [$($keys:tt)*] $values:tt
        $(#[doc = $about:literal])+
        $key:ident = $kind:expr, $default:literal, $example:tt $(in $choices:path)? $(, $range:ident)?;
        $($rows:tt)*
    ) => {
        table! {
            @rows $head $fields
            [$($keys)* &[table!(@key $key, $kind, $default, $example, concat!($($about),+), [$($range)?],
                table!(@choices $($choices)?))],]
            $values
            $($rows)*
        }
    };
    // A row of a field alone.
    (@rows $head:tt [$($fields:tt)*] $keys:tt [$($values:tt)*]
        $(#[$attribute:meta])+
        $field:ident: $type:ty => $read:path;
        $($rows:tt)*
    ) => {
        table! {
            @rows $head
            [$($fields)* $(#[$attribute])+ pub $field: $type,]
            $keys
            [$($values)* $field (keys $read)]
            $($rows)*
        }
    };
    // Keys that another table has as well.
    (@rows $head:tt $fields:tt [$($keys:tt)*] $values:tt keys of $table:expr; $($rows:tt)*) => {
        table! { @rows $head $fields [$($keys)* $table.keys,] $values $($rows)* }
    };
    (@rows $head:tt [$($fields:tt)*] $keys:tt [$($values:tt)*] $location:ident $(of $($place:ident),+)?) => {
        table! {
            @rows $head
            [$($fields)*
                /// Where it is written.
                #[serde(skip)]
                pub $location: $crate::scene::error::Location,
            ]
            $keys
            [$($values)* $location (place $($($place)+)?)]
        }
    };
    (
        @rows { $(#[$attribute:meta])* $visibility:vis static $name:ident $heading:tt $alternatives:tt }
        [] [$($keys:tt)+] []
    ) => {
        $(#[$attribute])*
        $visibility static $name: $crate::scene::schema::Table = table!(@table $heading, $alternatives, $($keys)+);
    };
    (
        @rows {
            $(#[$attribute:meta])* $visibility:vis struct $name:ident $heading:literal $alternatives:tt
            $($check:path)?
        }
        [$($fields:tt)+] [$($keys:tt)+] [$($field:ident $value:tt)+]
    ) => {
        $(#[$attribute])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize)]
        $visibility struct $name {
            $($fields)+
        }

        impl $crate::scene::table::Spec for $name {
            const TABLE: &'static $crate::scene::schema::Table = {
                static TABLE: $crate::scene::schema::Table = table!(@table $heading, $alternatives, $($keys)+);
                &TABLE
            };

            fn read(
                reader: &$crate::scene::reader::Reader,
            ) -> Result<Self, $crate::scene::error::SceneError> {
                reader.check_alternatives()?;
                let spec = Self { $($field: table!(@value reader $field $value),)+ };
                $($check(&spec, reader)?;)?
                Ok(spec)
            }
        }

        table!(@field $name);
    };
    (@field $name:ident) => {
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
        $visibility:vis enum $name:ident: $heading:literal {
            $(
                $(#[doc = $about:literal])+
                $form:ident($type:ty): $key:ident = $kind:expr, $example:literal;
            )+
        }
    ) => {
        $(#[$attribute])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize)]
        #[serde(rename_all = "snake_case")]
        $visibility enum $name {
            $($(#[doc = $about])+ $form($type),)+
        }

        impl $crate::scene::table::Spec for $name {
            const TABLE: &'static $crate::scene::schema::Table = {
                static TABLE: $crate::scene::schema::Table = table!(@table $heading, [[$(stringify!($key)),+]],
                    $(&[table!(@key $key, $kind, "one of", $example, concat!($($about),+), [], Vec::new)],)+);
                &TABLE
            };

            fn read(
                reader: &$crate::scene::reader::Reader,
            ) -> Result<Self, $crate::scene::error::SceneError> {
                let form = reader.which()?;
                $(if form == stringify!($key) {
                    return reader.field(form).map(Self::$form);
                })+
                unreachable!("{form} is no form of {}", $heading)
            }
        }

        table!(@field $name);
    };
    (
        $(#[$attribute:meta])*
        $visibility:vis $sort:ident $name:ident: $heading:tt
        $(, at most one of [$($alternative:literal),+])* $(, checked by $check:path)? { $($rows:tt)+ }
    ) => {
        table! {
            @rows {
                $(#[$attribute])* $visibility $sort $name $heading [$([$($alternative),+])*] $($check)?
            }
            [] [] [] $($rows)+
        }
    };
}
pub(crate) use table;
