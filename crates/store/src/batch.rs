//! A transaction as one text: all its statements go to the writing connection at once.
//!
//! Each round to the connection's thread and back costs as much as a small insert. A step of a run
//! is a handful of inserts, and there are hundreds of thousands of steps.

use sqlx::sqlite::SqliteArguments;
use sqlx::{Arguments as _, AssertSqlSafe, Encode, Sqlite, Type};

use crate::error::{StoreError, failed_to};
use crate::stamp::damaged;
use crate::writer::Writer;

/// Statements and what is bound to them, in order.
pub(crate) struct Batch {
    sql: String,
    arguments: SqliteArguments,
    refused: Option<String>,
}

impl Batch {
    pub(crate) fn new() -> Self {
        let sql = "BEGIN IMMEDIATE;\n".to_owned();
        Self { sql, arguments: SqliteArguments::default(), refused: None }
    }

    /// Adds a statement; its values follow by [`Batch::bind`].
    pub(crate) fn statement(&mut self, sql: &'static str) -> &mut Self {
        self.sql.push_str(sql);
        self.sql.push_str(";\n");
        self
    }

    /// Binds the next value of the statements so far.
    pub(crate) fn bind<'v, T: Encode<'v, Sqlite> + Type<Sqlite>>(&mut self, value: T) -> &mut Self {
        if let Err(error) = self.arguments.add(value) {
            self.refused.get_or_insert(error.to_string());
        }
        self
    }

    /// Does it all: durable when this returns, or nothing of it is there.
    pub(crate) async fn commit(self, writer: &Writer, doing: &str) -> Result<(), StoreError> {
        if let Some(reason) = self.refused {
            return Err(damaged("a value", reason));
        }
        // Only texts of this program are in it; every value is bound.
        let text = AssertSqlSafe(self.sql + "COMMIT");
        let mut write = writer.unbegun(doing).await?;
        let done = sqlx::query_with(text, self.arguments).execute(&mut *write).await;
        done.map_err(failed_to(doing))?;
        write.finished();
        Ok(())
    }
}
