import sys,re,math,collections,pickle,os
src=open('gain.py').read()
g={}
exec('import re,math\nR=4.0\nC=.25\n'+src[src.index('def geo'):src.index('C=0.25')]+src[src.index('def seen'):src.index('tot=')],g)
def data(fn):
    if os.path.exists(fn+'.pk'): return pickle.load(open(fn+'.pk','rb'))
    by=collections.defaultdict(list);Y={}
    for l in open(fn):
        w=l.split(None,3)
        if w and w[0]=='Y': Y[w[1]]=l
        elif w and w[0] in 'EP': by[w[1]].append(l)
    out=[]
    for k,ls in by.items():
        W,D,segs,_=g['geo'](Y[k]);have=set();pos=None;dump=None;cur=None;how=None;new=None;n=0
        for l in ls:
            w=l.split(None,4)
            if w[0]=='P': pos=tuple(map(float,l.split()[3:5]));continue
            if w[3]=='Heard' and 'Engine(Dock)' in l and pos:
                s=g['seen'](pos,segs,W,D);new=len(s-have)*.0625;have|=s
            elif w[3]=='Log':
                if ' R end' in l: how=l.split(' R end')[1]; endp=tuple(map(float,how.split()[:2]))
                if ' B ' in l:
                    t=l.split();i=t.index('B')
                    if cur and how: out.append((k,n,cur[0],cur[1],endp,new))
                    n+=1;how=None
                    cur=({},set())
                elif ' M ' in l:
                    t=l.split()
                    for c in t[t.index('M')+1:]:
                        a=c.split(',');kk=(int(a[0]),int(a[1]));cur[0][kk]=int(a[2])/10
                        if a[3]=='1': cur[1].add(kk)
    pickle.dump(out,open(fn+'.pk','wb'))
    return out
C=.15
def lines(n,S=20):
    L=[]
    for d in range(1,n+1):
        a=d*2*math.pi/n;L.append([(math.floor(math.cos(a)*r+.5),math.floor(math.sin(a)*r+.5)) for r in range(1,S+1)])
    return L
L30=lines(30)
B4=((1,0),(-1,0),(0,1),(0,-1))
def gain(ev,se,k,INTO=6,thr=.2,roomchk=True):
    s=0
    for L in L30:
        u=0
        for away,(x,y) in enumerate(L,1):
            c=(k[0]+x,k[1]+y);v=ev.get(c,0)
            if v>thr: break
            if v>=-.2:
                u+=1
                if u>INTO or (roomchk and any(ev.get((c[0]+a,c[1]+b),0)>.2 for a,b in B4)): break
            if c not in se: s+=away
    return s*C*C*2*math.pi/30
def ranks(v):
    o=sorted(range(len(v)),key=lambda i:v[i]);r=[0]*len(v)
    for i,j in enumerate(o): r[j]=i
    return r
def corr(a,b):
    n=len(a);ma=sum(a)/n;mb=sum(b)/n
    return sum((x-ma)*(y-mb) for x,y in zip(a,b))/math.sqrt(sum((x-ma)**2 for x in a)*sum((y-mb)**2 for y in b))
if __name__=='__main__':
    d=[]
    for f in sys.argv[1:]: d+=data(f)
    d=[x for x in d if x[5] is not None]
    true=[x[5] for x in d]
    print(len(d),'searches; vain',sum(t<1 for t in true)/len(true))
    for name,kw in [('into 3',dict(INTO=3)),('into 6',dict(INTO=6)),('into 10',dict(INTO=10)),('into 20',dict(INTO=20)),('into 6 thr1',dict(thr=1)),('into 20 thr1',dict(INTO=20,thr=1))]:
        p=[gain(x[2],x[3],(math.floor(x[4][0]/C),math.floor(x[4][1]/C)),**kw) for x in d]
        print(name,'corr %.2f rank %.2f'%(corr(p,true),corr(ranks(p),ranks(true))),end=' ')
        # by quintile of promise: mean true, vain
        o=sorted(zip(p,true));n=len(o)
        print(' '.join('[%.1f-%.1f: %.1f vain %.2f]'%(o[i*n//5][0],o[(i+1)*n//5-1][0],sum(t for _,t in o[i*n//5:(i+1)*n//5])/(n/5),sum(t<1 for _,t in o[i*n//5:(i+1)*n//5])/(n/5)) for i in range(5)))
