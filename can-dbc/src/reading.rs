//! A value that a sender may not have.

use serde::{Deserialize, Serialize};

/// What a J1939 signal says: a value, that there is an error, or that there is no value.
///
/// J1939 keeps the top of every signal's raw range for this, so that a missing value is never
/// mistaken for a large one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Reading<T> {
    /// The value.
    Value(T),
    /// The sender has the signal, but something is wrong with it.
    Error,
    /// The sender does not have the signal, or not now.
    #[default]
    NotAvailable,
}

impl<T> Reading<T> {
    /// The value, if there is one.
    pub fn value(self) -> Option<T> {
        match self {
            Self::Value(value) => Some(value),
            Self::Error | Self::NotAvailable => None,
        }
    }

    /// The same, with another value.
    pub fn map<U>(self, change: impl FnOnce(T) -> U) -> Reading<U> {
        match self {
            Self::Value(value) => Reading::Value(change(value)),
            Self::Error => Reading::Error,
            Self::NotAvailable => Reading::NotAvailable,
        }
    }
}

impl<T> From<Option<T>> for Reading<T> {
    /// `None` is not available.
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::NotAvailable, Self::Value)
    }
}
