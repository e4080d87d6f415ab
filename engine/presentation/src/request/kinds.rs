//! The kinds that a study may use: those of this crate, and those that other crates registered.

use crate::{
    figure::{self, Figure},
    kinds::{Kind, Readable},
    table::{self, Table},
};
use contract::Registry;
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use std::fmt;

/// The kinds of tables and figures that a study may use.
pub struct Kinds {
    /// Kinds of tables, those of the engine first.
    pub tables: Vec<Readable<dyn Table>>,
    /// Kinds of figures, those of the engine first.
    pub figures: Vec<Readable<dyn Figure>>,
}

impl Default for Kinds {
    /// The kinds of the engine.
    fn default() -> Self {
        Self {
            tables: table::kinds(),
            figures: figure::kinds(),
        }
    }
}

impl Kinds {
    /// The kinds of the engine and those that other crates registered.
    #[must_use]
    pub fn of(registry: &Registry) -> Self {
        let mut all = Self::default();
        all.tables.extend(registry.extensions::<Readable<dyn Table>>());
        all.figures.extend(registry.extensions::<Readable<dyn Figure>>());
        all
    }

    /// Facts on the kinds of tables.
    #[must_use]
    pub fn of_tables(&self) -> Vec<Kind> {
        self.tables.iter().map(|it| it.kind).collect()
    }

    /// Facts on the kinds of figures.
    #[must_use]
    pub fn of_figures(&self) -> Vec<Kind> {
        self.figures.iter().map(|it| it.kind).collect()
    }
}

impl fmt::Debug for Kinds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kinds = self.of_tables().into_iter().chain(self.of_figures());
        f.debug_set().entries(kinds.map(|kind| kind.name)).finish()
    }
}

/// Registration of kinds of tables and figures.
pub trait RegisterKinds {
    /// Registers a kind of tables.
    ///
    /// # Panics
    /// Where the name is taken: a mistake in the program, found by every test.
    fn table<T: Table + DeserializeOwned + JsonSchema>(&mut self);

    /// Registers a kind of figures.
    ///
    /// # Panics
    /// Where the name is taken: a mistake in the program, found by every test.
    fn figure<F: Figure + DeserializeOwned + JsonSchema>(&mut self);
}

impl RegisterKinds for Registry {
    fn table<T: Table + DeserializeOwned + JsonSchema>(&mut self) {
        let taken = Kinds::of(self).of_tables();
        assert!(
            taken.iter().all(|kind| kind.name != T::name()),
            "the kind of tables `{}` is registered twice",
            T::name()
        );
        self.extend(table::kind::<T>());
    }

    fn figure<F: Figure + DeserializeOwned + JsonSchema>(&mut self) {
        let taken = Kinds::of(self).of_figures();
        assert!(
            taken.iter().all(|kind| kind.name != F::name()),
            "the kind of figures `{}` is registered twice",
            F::name()
        );
        self.extend(figure::kind::<F>());
    }
}
