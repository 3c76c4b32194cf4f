-- A letter swapped in a namespace.
-- expect: check 3: unknown name 'robto'; did you mean 'robot'?
robto.move(50, 50)
