//! One definition makes a type, its reader and its JSON Schema.
//!
//! `record!` is a map with known keys, `choice!` a map with one key that says which (externally
//! tagged), `words!` one of a few words.

/// The key of a field: its name, or another one where Rust does not allow that name.
macro_rules! key {
    ($field:ident) => {
        stringify!($field)
    };
    ($field:ident $key:literal) => {
        $key
    };
}

/// The check of a field, if it has one.
macro_rules! check {
    () => {
        |_| Ok(())
    };
    ($check:path) => {
        $check
    };
}

macro_rules! record {
    ($(#[doc = $doc:literal])* pub struct $name:ident {
        $($(#[doc = $fdoc:literal])* $field:ident $(as $key:literal)? : $ty:ty $(=> $check:path)?,)*
    }) => {
        $(#[doc = $doc])*
        #[derive(Debug, Clone, PartialEq, serde::Serialize)]
        pub struct $name {
            $($(#[doc = $fdoc])* pub $field: $ty,)*
        }

        impl schemars::JsonSchema for $name {
            fn schema_name() -> std::borrow::Cow<'static, str> {
                stringify!($name).into()
            }

            fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
                let properties = <Self as $crate::reader::Record>::properties(generator);
                $crate::reader::object_schema(concat!($($doc, "\n"),*), properties)
            }
        }

        impl $crate::reader::Record for $name {
            const KEYS: &'static [&'static str] = &[$(key!($field $($key)?)),*];

            fn properties(
                generator: &mut schemars::SchemaGenerator,
            ) -> Vec<$crate::reader::Property> {
                vec![$($crate::reader::Property {
                    key: key!($field $($key)?),
                    doc: concat!($($fdoc, "\n"),*),
                    required: <$ty as $crate::reader::Read>::required(),
                    schema: <$ty as $crate::reader::Read>::schema(generator),
                }),*]
            }
        }

        impl $crate::reader::Read for $name {
            fn read(
                node: &$crate::tree::Node,
                reader: &mut $crate::reader::Reader,
            ) -> Option<Self> {
                let keys = <Self as $crate::reader::Record>::KEYS;
                let mut fields = $crate::reader::Fields::of(node, keys, reader)?;
                $(let $field: Option<$ty> =
                    fields.take(key!($field $($key)?), check!($($check)?), reader);)*
                Some(Self { $($field: $field?),* })
            }

            fn broken() -> Option<Self> {
                Some(Self { $($field: <$ty as $crate::reader::Read>::broken()?),* })
            }

            fn schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
                generator.subschema_for::<Self>()
            }
        }
    };
}

macro_rules! choice {
    ($(#[doc = $doc:literal])* pub enum $name:ident ($what:literal) {
        $($(#[doc = $vdoc:literal])* $key:literal => $variant:ident($ty:ty),)*
    }) => {
        $(#[doc = $doc])*
        #[derive(Debug, Clone, PartialEq, serde::Serialize)]
        #[serde(rename_all = "snake_case")]
        pub enum $name {
            $($(#[doc = $vdoc])* $variant($ty),)*
        }

        impl schemars::JsonSchema for $name {
            fn schema_name() -> std::borrow::Cow<'static, str> {
                stringify!($name).into()
            }

            fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
                <Self as $crate::reader::Choice>::schema_with(|_| Vec::new(), generator)
            }
        }

        impl $crate::reader::Choice for $name {
            const KEYS: &'static [&'static str] = &[$($key),*];

            fn schema_with(
                beside: fn(&mut schemars::SchemaGenerator) -> Vec<$crate::reader::Property>,
                generator: &mut schemars::SchemaGenerator,
            ) -> schemars::Schema {
                let choices: Vec<schemars::Schema> = vec![$({
                    let schema = <$ty as $crate::reader::Read>::schema(generator);
                    let doc = concat!($($vdoc, "\n"),*);
                    let mut properties =
                        vec![$crate::reader::Property { key: $key, doc, required: true, schema }];
                    properties.extend(beside(generator));
                    $crate::reader::object_schema(doc, properties)
                }),*];
                let doc = concat!($($doc, "\n"),*).trim();
                schemars::json_schema!({ "description": doc, "oneOf": choices })
            }
        }

        impl $crate::reader::Read for $name {
            fn read(
                node: &$crate::tree::Node,
                reader: &mut $crate::reader::Reader,
            ) -> Option<Self> {
                let (key, value) = reader.one_of(node, $what, <Self as $crate::reader::Choice>::KEYS)?;
                match key {
                    $($key => <$ty as $crate::reader::Read>::read(value, reader).map(Self::$variant),)*
                    _ => None,
                }
            }

            fn schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
                generator.subschema_for::<Self>()
            }
        }
    };
}

macro_rules! words {
    ($(#[doc = $doc:literal])* pub enum $name:ident ($what:literal) {
        $($(#[doc = $vdoc:literal])* $key:literal => $variant:ident,)*
    }) => {
        $(#[doc = $doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
        pub enum $name {
            $($(#[doc = $vdoc])* #[serde(rename = $key)] $variant,)*
        }

        impl $name {
            /// The word in the file.
            #[must_use]
            pub const fn as_str(self) -> &'static str {
                match self {
                    $(Self::$variant => $key,)*
                }
            }
        }

        impl schemars::JsonSchema for $name {
            fn schema_name() -> std::borrow::Cow<'static, str> {
                stringify!($name).into()
            }

            fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
                let words = vec![$(serde_json::json!({
                    "const": $key,
                    "description": concat!($($vdoc, "\n"),*).trim(),
                })),*];
                let doc = concat!($($doc, "\n"),*).trim();
                schemars::json_schema!({ "description": doc, "oneOf": words })
            }
        }

        impl $crate::reader::Read for $name {
            fn read(
                node: &$crate::tree::Node,
                reader: &mut $crate::reader::Reader,
            ) -> Option<Self> {
                match reader.word(node, $what, &[$($key),*])? {
                    $($key => Some(Self::$variant),)*
                    _ => None,
                }
            }

            fn schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
                generator.subschema_for::<Self>()
            }
        }
    };
}
