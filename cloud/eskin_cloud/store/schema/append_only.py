"""Tables to which rows are only ever added; triggers refuse the rest."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqlalchemy import DDL, event

if TYPE_CHECKING:
    from sqlalchemy import Table
    from sqlalchemy.schema import ExecutableDDLElement


def keep_append_only(table: Table) -> None:
    """Have a table's rows neither changed nor removed, in whichever store it is made."""
    name = table.name
    why = f"'the {name.replace('_', ' ')} is append only'"
    for verb in ("UPDATE", "DELETE"):
        _after_create(
            table,
            "sqlite",
            f"CREATE TRIGGER {name}_no_{verb.lower()} BEFORE {verb} ON {name} "
            f"BEGIN SELECT RAISE(ABORT, {why}); END",
        )
    _after_create(
        table,
        "postgresql",
        f"CREATE FUNCTION {name}_refuse() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN "
        f"RAISE EXCEPTION {why} USING ERRCODE = 'integrity_constraint_violation'; END $$",
    )
    _after_create(
        table,
        "postgresql",
        f"CREATE TRIGGER {name}_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON {name} "
        f"FOR EACH STATEMENT EXECUTE FUNCTION {name}_refuse()",
    )


def _after_create(table: Table, dialect: str, statement: str) -> None:
    made: ExecutableDDLElement = DDL(statement)  # type: ignore[no-untyped-call]  # untyped in SQLAlchemy
    event.listen(table, "after_create", made.execute_if(dialect=dialect))
