-- A module that requires itself.
-- expect: error
pcall(require, "./require_itself")
require("./require_itself")
