-- An error that says nothing.
-- expect: run 3: the error is a table, which says nothing here
error({ code = 5 })
