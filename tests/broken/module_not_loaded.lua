-- A module that was not loaded.
-- expect: check 3: unknown name 'easy'
easy.drive(50)
