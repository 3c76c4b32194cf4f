-- A module that needs itself.
-- expect: error
pcall(require, "./require_itself")
require("./require_itself")
