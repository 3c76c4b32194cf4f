import pickle,collections,math,re
from qa import est,q
o=pickle.load(open('/tmp/qs.pkl','rb'))
fn='r_qs_genuine_101.out'
kinds={}
for l in open(fn):
    if not l.startswith('Y '): continue
    k=l.split()[1];parts=l.split(' || ');ks=['outer']*4
    ks+=['wall']*4*len(re.findall(r'Wall \{',parts[1]))
    f=re.findall(r'Furniture \{[^}]*?height: ([\d.]+)[^}]*?colour: Paint\(\[(\d+), (\d+), (\d+)',l)
    for h,*c in f: ks+=['furn %s'%( '<.5' if float(h)<.5 else '<1' if float(h)<1 else '>1')]*4
    ks+=['post']*40
    room=parts[0]
    kinds[k]=(ks,re.search(r'floor: (\w+)',room)[1],re.search(r'decor: (\w+)',room)[1])
geo={};L=open('/tmp/qs.geo').read().split('\n');i=0
while i<len(L):
    if L[i].startswith('K '):
        _,k,n=L[i].split();n=int(n);geo[k]=[tuple(map(float,x.split())) for x in L[i+1:i+1+n]];i+=n+1
    else: i+=1
def casti(segs,x,y,a):
    dx,dy=math.cos(a),math.sin(a);r=99.;b=-1
    for i,(x1,y1,x2,y2) in enumerate(segs):
        ex,ey=x2-x1,y2-y1;den=dx*ey-dy*ex
        if abs(den)<1e-9: continue
        t=((x1-x)*ey-(y1-y)*ex)/den;u=((x1-x)*dy-(y1-y)*dx)/den
        if t>0 and 0<=u<=1 and t<r: r=t;b=i
    return b
N=collections.Counter();G=collections.Counter();F=collections.Counter();FN=collections.Counter();edge=collections.Counter();shortc=collections.Counter()
for s in o:
    ks,fl,de=kinds[s['key']];x,y,h=s['true'];n=len(s['rows']);E=[est(r[3],.5) for r in s['rows']];rows=sorted(range(n),key=lambda i:s['rows'][i][0])
    pos={i:j for j,i in enumerate(rows)}
    for i,(r,t) in enumerate(zip(s['rows'],s['td'])):
        if not .9<t<3: continue
        b=casti(geo[s['key']],x,y,h+r[0]);k=ks[b] if b<len(ks) else '?'
        N[k]+=1;FN[fl,de]+=1
        e=E[i]
        if e and e>1.25*t:
            G[k]+=1;F[fl,de]+=1
            j=pos[i];nb=[s['td'][rows[(j+d)%n]] for d in (-2,-1,1,2)]
            edge['near a jump' if max(nb)>.8*e else 'inside']+=1
print({k:(N[k],round(G[k]/N[k],3)) for k in N});print({k:(FN[k],round(F[k]/FN[k],3)) for k in FN});print(edge)
