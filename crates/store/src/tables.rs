//! The tables of a session, as the schema itself tells them: what is deleted, exported and imported
//! with it. A table that a later migration adds is found here without being named: by its column
//! `session` or `processing`. What no session owns (pictures, calibrations) is copied by `transfer`.

use sqlx::{AssertSqlSafe, FromRow, SqliteConnection};

/// The pictures of one session (`?1`), of its earlier attempts included, by their hashes.
pub(crate) fn blobs_of_session(schema: &str) -> String {
    format!(
        "SELECT blake3 FROM {schema}.pictures WHERE session = ?1
         UNION
         SELECT json_extract(p.value, '$.blake3')
         FROM {schema}.attempts a, json_each(a.capture_json, '$.pictures') p
         WHERE a.session = ?1"
    )
}

/// A column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Column {
    /// Its name.
    pub name: String,
    /// The table whose row numbers it holds: its own, or one that it refers to. A row number means
    /// nothing outside of its database.
    pub numbers: Option<String>,
    /// True where it holds text.
    pub is_text: bool,
}

/// A table with rows of sessions.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct SessionTable {
    /// Its name.
    pub name: String,
    /// Its columns, in their order.
    pub columns: Vec<Column>,
    /// The columns of its primary key.
    pub key: Vec<String>,
}

impl SessionTable {
    /// Which rows are those of the session `?1`, as a condition on the table called `alias` in the
    /// database called `schema`.
    pub fn owned(&self, schema: &str, alias: &str) -> String {
        let has = |name: &str| self.columns.iter().any(|column| column.name == name);
        if self.name == "sessions" {
            format!("{alias}.id = ?1")
        } else if has("session") {
            format!("{alias}.session = ?1")
        } else {
            format!(
                "{alias}.processing IN (SELECT id FROM {schema}.processings WHERE session = ?1)"
            )
        }
    }
}

#[derive(FromRow)]
struct Info {
    name: String,
    #[sqlx(rename = "type")]
    kind: String,
    pk: i64,
}

#[derive(FromRow)]
struct Reference {
    table: String,
    from: String,
    to: Option<String>,
}

/// Quotes a name that the schema gave.
pub(crate) fn quoted(name: &str) -> String {
    format!("\"{}\"", name.replace('"', "\"\""))
}

/// The tables of `schema` (`main`, or an attached database) that hold rows of sessions.
pub(crate) async fn session_tables(
    connection: &mut SqliteConnection,
    schema: &str,
) -> Result<Vec<SessionTable>, sqlx::Error> {
    let names: Vec<String> = sqlx::query_scalar(AssertSqlSafe(format!(
        "SELECT name FROM {schema}.sqlite_schema WHERE type = 'table'
            AND name NOT LIKE 'sqlite\\_%' ESCAPE '\\' AND name NOT LIKE '\\_%' ESCAPE '\\'
         ORDER BY name"
    )))
    .fetch_all(&mut *connection)
    .await?;
    let mut tables = Vec::new();
    for name in names {
        let table = table(connection, schema, name).await?;
        let owned = ["session", "processing"];
        let is_owned = table.columns.iter().any(|c| owned.contains(&c.name.as_str()));
        if is_owned || table.name == "sessions" {
            tables.push(table);
        }
    }
    Ok(tables)
}

/// The names of a table's columns, in their order; none where there is no such table.
pub(crate) async fn columns_of(
    connection: &mut SqliteConnection,
    schema: &str,
    table: &str,
) -> Result<Vec<String>, sqlx::Error> {
    Ok(info(connection, schema, table).await?.into_iter().map(|column| column.name).collect())
}

async fn table(
    connection: &mut SqliteConnection,
    schema: &str,
    name: String,
) -> Result<SessionTable, sqlx::Error> {
    let info = info(connection, schema, &name).await?;
    let mut columns = Vec::new();
    for column in &info {
        let numbers = numbers(connection, schema, &name, &column.name).await?;
        let is_text = column.kind == "TEXT";
        columns.push(Column { name: column.name.clone(), numbers, is_text });
    }
    let mut key: Vec<&Info> = info.iter().filter(|column| column.pk > 0).collect();
    key.sort_by_key(|column| column.pk);
    let key = key.into_iter().map(|column| column.name.clone()).collect();
    Ok(SessionTable { name, columns, key })
}

async fn info(
    connection: &mut SqliteConnection,
    schema: &str,
    table: &str,
) -> Result<Vec<Info>, sqlx::Error> {
    sqlx::query_as("SELECT name, type, pk FROM pragma_table_info(?1, ?2) ORDER BY cid")
        .bind(table)
        .bind(schema)
        .fetch_all(connection)
        .await
}

/// The table whose row numbers a column holds, along its references.
async fn numbers(
    connection: &mut SqliteConnection,
    schema: &str,
    table: &str,
    column: &str,
) -> Result<Option<String>, sqlx::Error> {
    let (mut table, mut column) = (table.to_owned(), column.to_owned());
    // A chain of references is shorter than that; a circle of them ends here.
    for _ in 0..8 {
        let info = info(connection, schema, &table).await?;
        let key: Vec<&Info> = info.iter().filter(|column| column.pk > 0).collect();
        if matches!(key.as_slice(), [one] if one.name == column && one.kind == "INTEGER") {
            return Ok(Some(table));
        }
        let references: Vec<Reference> = sqlx::query_as(
            "SELECT \"table\", \"from\", \"to\" FROM pragma_foreign_key_list(?1, ?2) ORDER BY id",
        )
        .bind(&table)
        .bind(schema)
        .fetch_all(&mut *connection)
        .await?;
        let Some(next) = references.into_iter().find(|r| r.from == column && r.to.is_some()) else {
            return Ok(None);
        };
        (table, column) = (next.table, next.to.unwrap_or_default());
    }
    Ok(None)
}
