import sys
sys.argv
from ld import load
d=load(sys.argv[1])
o=open(sys.argv[2],'w')
for k,segs in d.items():
    o.write('K %s\n'%k)
    for i,g in enumerate(segs):
        if i: o.write('F\n')
        for r in g:
            fmt=lambda rays:' '.join('%g %g %d %g %g'%(a,d,k,l,n) for a,d,k,l,n in rays)
            if r[0]=='S': o.write('S %s %s %s %d %s\n'%(' '.join('%g'%x for x in r[1]),' '.join('%g'%x for x in r[3]),' '.join('%g'%x for x in r[4]),len(r[2]),fmt(r[2])))
            else: o.write('W %s %s %d %s\n'%(' '.join('%g'%x for x in r[1]),' '.join('%g'%x for x in r[3]),len(r[2]),fmt(r[2])))
