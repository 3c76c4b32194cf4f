import sys
sys.argv,files=['x'],sys.argv[1:]
import pred
from pred import *
src=open('pred2.py').read()
exec(src[src.index('def load'):src.index('d=[]')])
d=[]
for f in files: d+=load(f)
d=[x for x in d if x[5] is not None]
T=[x[5] for x in d];nov=[min(math.dist(x[4],q) for q in x[6]) for x in d]
def G(ev,se,k,L,INTO,thr,room):
    s=0
    for Ln in L:
        u=0
        for away,(x,y) in enumerate(Ln,1):
            c=(k[0]+x,k[1]+y);v=ev.get(c,0)
            if v>thr: break
            if v>=-.2:
                u+=1
                if u>INTO or (room and any(ev.get((c[0]+a,c[1]+b),0)>thr for a,b in B4)): break
            if c not in se: s+=away
    return s*C*C*2*math.pi/30
for S,INTO,thr,room in [(20,6,.2,1),(27,6,.2,1),(27,10,.2,1),(27,14,.2,1),(27,20,.2,1),(27,10,1,1),(27,10,2,1),(27,10,.2,0),(27,10,1,0),(20,10,.2,1),(20,10,1,0)]:
    L=lines(30,S)
    P=[G(x[2],x[3],(math.floor(x[4][0]/C),math.floor(x[4][1]/C)),L,INTO,thr,room) for x in d]
    W=[(p+.5)*min(n,2) for p,n in zip(P,nov)]
    o=sorted(zip(W,T));n=len(o)
    print('S %d into %d thr %.1f room %d: p corr %.2f rank %.2f  w corr %.2f rank %.2f'%(S,INTO,thr,room,corr(P,T),corr(ranks(P),ranks(T)),corr(W,T),corr(ranks(W),ranks(T))),' '.join('[%.1f: %.1f v%.2f]'%(o[i*n//6][0],sum(t for _,t in o[i*n//6:(i+1)*n//6])/(n/6),sum(t<1 for _,t in o[i*n//6:(i+1)*n//6])/(n/6)) for i in range(6)),flush=True)
