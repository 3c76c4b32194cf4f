-- {{NAME}}
--
-- Try it:  spykee run {{NAME}}.lua --sim

print("hello from {{NAME}}")
